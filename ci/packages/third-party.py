#!/usr/bin/env python3
"""Prints the licences of the crates that the Python package, and with it the program, links.

    ci/packages/third-party.py TARGET

A crate that comes without the text of its licence is listed with the licence's name.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

NAMES = re.compile("licen[sc]e|copying|notice|unlicense", re.IGNORECASE)


def linked(metadata, root):
    """Ids of the packages that are linked into `root`: no build scripts, no tests."""
    nodes = {node["id"]: node["deps"] for node in metadata["resolve"]["nodes"]}
    waiting, seen = [root], set()
    while waiting:
        package = waiting.pop()
        if package not in seen:
            seen.add(package)
            waiting += [
                dep["pkg"]
                for dep in nodes[package]
                if any(kind["kind"] is None for kind in dep["dep_kinds"])
            ]
    return seen


def main():
    command = ["cargo", "metadata", "--format-version", "1", "--locked"]
    command += ["--filter-platform", sys.argv[1]]
    metadata = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    packages = {package["id"]: package for package in metadata["packages"]}
    root = next(p["id"] for p in packages.values() if p["name"] == "camrig-python")
    users = {}  # by the words of a text: the text, and the crates that have it
    for package in (packages[id] for id in linked(metadata, root)):
        if package["source"] is None:
            continue
        folder = Path(package["manifest_path"]).parent
        files = [file for file in folder.iterdir() if NAMES.match(file.name) and file.is_file()]
        texts = [file.read_text("utf-8", "replace").strip() for file in files]
        for text in texts or [f"{package['license']} (the crate has no text of it)"]:
            words = " ".join(text.split()).lower()  # lines are broken here and there
            _, names = users.setdefault(words, (text, set()))
            names.add(f"{package['name']} {package['version']}")
    for text, names in sorted(users.values(), key=lambda item: sorted(item[1])):
        print("=" * 80, ", ".join(sorted(names)), "", text, "", sep="\n")


if __name__ == "__main__":
    main()
