"""Long calls: the lock, Ctrl-C, progress, memory."""

import os
import resource
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import camrig


def test_others_run_meanwhile(camera):
    """A thread counts while frames are taken; with the lock held it would not count at all."""
    count, stop = 0, threading.Event()

    def counting():
        nonlocal count
        while not stop.is_set():
            count += 1
            time.sleep(0.0005)

    light = camera.set(width=1024, height=768).irradiance("uniform:0.18", lux=300, cache=False)
    thread = threading.Thread(target=counting)
    thread.start()
    before = count
    camera.set(width=1024, height=768).expose(light, 0.01, frames=6)
    during = count - before
    stop.set()
    thread.join()
    assert during > 5


LONG = """
import camrig, signal, sys
# What starts tests in the background may have it ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
camera = camrig.Camera("mt9t012")
print("begins", flush=True)
try:
    camera.simulate("colorchecker", 0.01, lux=300, cache=False, oversample=4,
                    progress=lambda what, done, total: print(what, done, total, flush=True))
except KeyboardInterrupt:
    print("interrupted")
    sys.exit(7)
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_ends_a_long_call():
    process = subprocess.Popen([sys.executable, "-c", LONG], stdout=subprocess.PIPE, text=True)
    said = [process.stdout.readline(), process.stdout.readline()]
    assert said[0] == "begins\n" and said[1].startswith("optics ")
    process.send_signal(signal.SIGINT)
    rest, _ = process.communicate(timeout=60)
    assert process.returncode == 7 and rest.endswith("interrupted\n")


def test_an_exception_of_progress_ends_the_call(camera):
    def stop(*_):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        camera.irradiance("colorchecker", lux=300, cache=False, progress=stop)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="kilobytes of Linux")
def test_arrays_are_not_copied():
    """16 frames of 4 Mpixels, 128 MiB, are measured with less than that more memory."""
    frames = np.random.default_rng(2).integers(60, 70, (16, 2048, 2048), dtype=np.uint16)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    captures = camrig.Captures({"dark": dict(frames=frames, role="dark", exposure_s=0.0)}, bits=10)
    more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert captures.shape == (2048, 2048) and more < 16 * 1024
