#!/usr/bin/env python3
"""Builds the documentation site in target/site/html: the repository's pages, and those made here.

    pip install mkdocs-material mkdocstrings-python nbclient nbconvert ipykernel matplotlib
    cargo build -p camrig-cli -p camrig-python
    docs/site/build.py

The pages keep their places, so that links read the same here and on a code host: README.md and
whatever it and the sections of mkdocs.yml lead to. Added are a page for each effect and command, as
the program (in target/debug) describes them, the Python package from its docstrings, and the
notebooks with what they print and draw. A link that leads nowhere is an error.
"""

import html
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

ROOT = Path(__file__).resolve().parents[2]
SITE = ROOT / "target/site"
SOURCE = SITE / "source"
BUILT = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "debug"
PROGRAM = BUILT / "camrig"
MODULES = ("camrig", "camrig.measure", "camrig.plot", "camrig.augment", "camrig.batch")
CELL_TIMEOUT_S = 120


def ask(*arguments):
    return subprocess.run([PROGRAM, *arguments], check=True, capture_output=True, text=True).stdout


def write(page, text):
    path = SOURCE / page
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def copy_pages(first):
    """Copies pages, what they link to and what that links to, each to its place."""
    waiting, seen = [ROOT / page for page in first], set()
    while waiting:
        file = waiting.pop()
        if file in seen or not file.is_file() or ROOT not in file.parents:
            continue
        seen.add(file)
        if file.suffix == ".md":
            text = file.read_text(encoding="utf-8").replace(".ipynb)", ".md)")
            # The guide names the program that a block needs behind its language.
            write(file.relative_to(ROOT), re.sub(r"^```sh .*", "```sh", text, flags=re.M))
            links = re.findall(r"\]\(([^)#:\s]+)", text)
            waiting += [(file.parent / link).resolve() for link in links]
        else:
            copy = SOURCE / file.relative_to(ROOT)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, copy)


def in_table(text):
    return html.escape(" ".join(str(text).split()), quote=False).replace("|", "\\|")


def effects():
    """A page for each effect, its validity sheet, and their list; the section of the navigation."""
    table = "| effect | acts on | what it is |\n|---|---|---|\n"
    kinds = []
    for effect in json.loads(ask("effects", "--json"))["effects"]:
        kind, acts_on = effect["kind"], effect["acts_on"]
        lines = [line.strip() for line in effect["doc"].splitlines()]
        page = f"# {kind}\n\n" + html.escape("\n".join(lines), quote=False).replace("*", "\\*")
        page += f"\n\nActs on: {acts_on}."
        if effect["number"] is not None:
            page += f" Number on the link of a rig: {effect['number']}."
        if effect["test"]:
            page += (
                "\n\nChecked against its closed form over the ranges below, in f32 and in fixed"
                f" point: test `{effect['test']}` of `camrig-sensor-core`."
            )
        page += "\n\n| key | meaning | unit | range | default |\n|---|---|---|---|---|\n"
        for word in effect["words"]:
            values = ", ".join(f"`{value}`" for value in word["values"])
            default = "required" if word["required"] else ""
            page += f"| `{word['key']}` | {in_table(word['doc'])} | | {values} | {default} |\n"
        for key in effect["parameters"]:
            default = "required" if key["default"] is None else f"{key['default']:g}"
            page += f"| `{key['key']}` | {in_table(key['doc'])} | {key['unit']} "
            page += f"| {key['min']:g} to {key['max']:g} | {default} |\n"
        text = ask("effects", kind)
        page += f"\nIn a camera file:\n\n```toml\n{text[text.index('[[effect]]') :]}```\n"
        write(f"effects/{kind}.md", page)
        what = " ".join(lines).split(": ", 1)[-1].split(". ")[0].rstrip(".")
        table += f"| [{kind}]({kind}.md) | {acts_on} | {in_table(what)} |\n"
        kinds.append(kind)
    write("effects/README.md", "# Effects\n\nIn the order in which the model has them; `camrig "
          f"effects` prints the same.\n\n{table}")
    nav = "  - Effects:\n      - effects/README.md\n"
    return nav + "".join(f"      - {kind}: effects/{kind}.md\n" for kind in sorted(kinds))


def commands():
    """A page for each command with its subcommands, as `--help` prints them; the section."""
    manual = SITE / "manual"
    ask("man", "-o", manual, "--force", "--quiet")
    names = sorted(page.stem.split("-")[1:] for page in manual.glob("camrig-*.1"))
    nav = "  - Commands:\n"
    for name in (name for name in names if len(name) == 1):
        page = f"# camrig {name[0]}\n"
        for words in (words for words in names if words[0] == name[0]):
            if words != name:
                page += f"\n## camrig {' '.join(words)}\n"
            page += f"\n```text\n{ask(*words, '--help').strip()}\n```\n"
        write(f"commands/{name[0]}.md", page)
        nav += f"      - {name[0]}: commands/{name[0]}.md\n"
    return nav


def python():
    """A page for each module of the Python package; the section."""
    package = SITE / "package/camrig"
    package.mkdir(parents=True)
    for file in (ROOT / "host/python/python/camrig").glob("*.py*"):
        roles = r":(?:class|func|meth):(`[^`]+`)"
        (package / file.name).write_text(re.sub(roles, r"\1", file.read_text(encoding="utf-8")))
    shutil.copy(BUILT / "deps/lib_camrig.so", package / "_camrig.abi3.so")
    nav = "  - Python:\n      - Overview: host/python/README.md\n"
    for module in MODULES:
        write(f"python/{module}.md", f"# {module}\n\n::: {module}\n    options:\n"
              "      show_root_heading: false\n      show_root_toc_entry: false\n")
        nav += f"      - {module}: python/{module}.md\n"
    return nav


def notebooks():
    """The notebooks as pages, with their results; the section."""
    import nbformat
    from nbclient import NotebookClient
    from nbconvert import MarkdownExporter

    os.environ["PATH"] = f"{BUILT}:{os.environ['PATH']}"
    os.environ["PYTHONPATH"] = str(SITE / "package")
    os.environ["XDG_CACHE_HOME"] = str(SITE / "cache")
    nav = "  - Notebooks:\n"
    for file in sorted((ROOT / "docs/notebooks").glob("*.ipynb")):
        notebook = nbformat.read(file, as_version=4)
        run_in = SITE / "runs" / file.stem
        run_in.mkdir(parents=True)
        NotebookClient(notebook, timeout=CELL_TIMEOUT_S, resources={"metadata": {"path": run_in}},
                       extra_arguments=["--IPKernelApp.log_level=ERROR"]).execute()
        names = {"unique_key": file.stem, "output_files_dir": file.stem}
        text, more = MarkdownExporter().from_notebook_node(notebook, resources=names)
        page = file.relative_to(ROOT).with_suffix(".md")
        write(page, text)
        for name, content in more["outputs"].items():
            picture = SOURCE / page.parent / name
            picture.parent.mkdir(exist_ok=True)
            picture.write_bytes(content)
        title = re.search(r"^# (.*)", text, re.M).group(1)
        nav += f"      - {title}: {page}\n"
    return nav


def broken_links():
    """What pages of the finished site refer to and the site lacks, or fetch from elsewhere."""
    pages = {page: page.read_text(encoding="utf-8") for page in (SITE / "html").rglob("*.html")}
    anchors = {page: set(re.findall(r'\sid="([^"]*)"', text)) for page, text in pages.items()}
    del pages[SITE / "html/404.html"]  # whose links begin at the site's root, wherever that is
    for page, text in pages.items():
        for tag, link in set(re.findall(r'<(\w+)[^>]*?\s(?:href|src)="([^"]*)"', text)):
            link = html.unescape(link)
            if re.match(r"https?:|mailto:", link):
                if tag != "a":
                    yield f"{page}: fetches {link}"
                continue
            path, _, anchor = link.partition("#")
            target = (page.parent / unquote(path)).resolve() if path else page
            if not target.is_file():
                yield f"{page}: no {link}"
            elif anchor and target in anchors and unquote(anchor) not in anchors[target]:
                yield f"{page}: no {link}"


def main():
    shutil.rmtree(SITE, ignore_errors=True)
    config = (ROOT / "docs/site/mkdocs.yml").read_text(encoding="utf-8")
    write("wide.css", (ROOT / "docs/site/wide.css").read_text())
    copy_pages(re.findall(r"[:-] (\S+\.md)$", config, re.M))
    for section in (python, effects, commands, notebooks):
        config = config.replace(f"  # {section.__name__}\n", section())
    (SITE / "mkdocs.yml").write_text(config, encoding="utf-8")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    subprocess.run(command, cwd=SITE, env=environment, check=True)
    broken = sorted(broken_links())
    print("\n".join(broken))
    pages = len(list((SITE / "html").rglob("*.html")))
    print(f"target/site/html: {pages} pages, {len(broken)} broken links")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
