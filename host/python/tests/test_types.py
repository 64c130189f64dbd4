"""Types for checkers: the stubs are those of the library, and the package keeps to them."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    "command",
    [("mypy", "--strict", "-p", "camrig"), ("mypy.stubtest", "camrig._camrig")],
    ids=["package", "stubs"],
)
def test_types(command, tmp_path):
    pytest.importorskip("mypy")
    pytest.importorskip("matplotlib")  # for the types of its axes
    run = [sys.executable, "-m", *command]
    done = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
