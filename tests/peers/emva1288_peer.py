#!/usr/bin/env python3
"""Figures of the independent `emva1288` package (PyPI, 1.0.2) for a capture set, as JSON.

    python -m venv venv && venv/bin/pip install 'numpy<2' emva1288==1.0.2 tifffile imagecodecs
    venv/bin/python tests/peers/emva1288_peer.py CAPTURES > figures.json

The package takes two frames per light level and wants a dark of every exposure time; a stack of
more than two frames is its spatial pair. Levels without such a dark are left out. With the figures
it makes what `camrig measure emva` makes too: two histograms and four spectrograms.
"""
import glob
import json
import os
import resource
import sys
import tempfile
import time
import tomllib

import numpy as np

if not hasattr(np, "asfarray"):  # removed in numpy 2
    np.asfarray = lambda a, dtype=float: np.asarray(a, dtype=dtype)

from emva1288 import process  # noqa: E402
from emva1288.process import routines  # noqa: E402


def frames(pattern):
    """Where the frames are: file, and which of its frames."""
    out = []
    for path in sorted(glob.glob(pattern)):
        shape = np.load(path, mmap_mode="r").shape if path.endswith(".npy") else (0, 0)
        out += [(path, k) for k in range(shape[0])] if len(shape) == 3 else [(path, None)]
    return out


def load(frame):
    path, k = frame
    if path.endswith(".npy"):
        return np.load(path) if k is None else np.load(path, mmap_mode="r")[k]
    import tifffile

    return tifffile.imread(path)


def main(root):
    start, cpu = time.perf_counter(), time.process_time()
    manifest = tomllib.load(open(os.path.join(root, "captures.toml"), "rb"))
    sensor = manifest["sensor"]
    stacks = {}
    for c in manifest["capture"]:
        if c["role"] not in ("dark", "flat"):
            continue
        rate = c.get("light", {}).get("photons_per_pixel_per_s", 0.0)
        stack = frames(os.path.join(root, c["files"]))
        key = (c["exposure_s"], c.get("temperature_c"), rate, len(stack) > 2)
        stacks.setdefault(key, stack)
    lines, images, dark_given = ["v 1.0"], {}, set()
    lines.append(f"n {sensor['bits']} {sensor['width']} {sensor['height']}")
    for (t, celsius, rate, long), stack in sorted(stacks.items(), key=str):
        if rate == 0.0:
            continue
        dark = stacks.get((t, celsius, 0.0, long)) or stacks.get((t, celsius, 0.0, not long))
        if dark is None:
            continue
        groups = [("d %.9f" % (t * 1e9), dark), ("b %.9f %.6f" % (t * 1e9, rate * t), stack)]
        if (t, long) in dark_given:
            del groups[0]
        dark_given.add((t, long))
        for head, group in groups:
            lines.append(head)
            for frame in group if long else group[:2]:
                name = f"{len(images)}.bin"
                images[name] = frame
                lines.append(f"i {name}")
    with tempfile.TemporaryDirectory() as d:
        path = os.path.join(d, "descriptor.txt")
        for name in images:
            open(os.path.join(d, name), "w").close()
        open(path, "w").write("\n".join(lines) + "\n")
        info = process.ParseEmvaDescriptorFile(path, loglevel=50)
        loaded = process.LoadImageData(
            info.images, d, fload=lambda p: load(images[os.path.basename(p)]), loglevel=50
        )
        data = process.Data1288(loaded.data)
        r = process.Results1288(data.data, loglevel=50)
    names = ["K", "R", "QE", "sigma_y_dark", "sigma_d", "u_p_min", "u_e_min", "u_p_sat", "u_e_sat",
             "SNR_max", "DR", "LE_min", "LE_max", "u_I_mean", "u_I_var", "DSNU1288", "DSNU1288_row",
             "DSNU1288_col", "DSNU1288_pixel", "PRNU1288", "PRNU1288_row", "PRNU1288_col",
             "PRNU1288_pixel"]
    figures = {n: float(getattr(r, n)) for n in names}
    # A root of a negative variance is no number, and none in JSON.
    figures = {n: v if np.isfinite(v) else None for n, v in figures.items()}
    pictures = [r.histogram_PRNU, r.histogram_DSNU]
    s = r.spatial
    flat = (s["sum"] - s["sum_dark"]) / s["L"]
    for turned in (False, True):
        pictures.append(routines.FFT1288(flat, rotate=turned))
        pictures.append(routines.FFT1288(s["sum_dark"], rotate=turned, n=s["L_dark"]))
    # Reading and analysis, without Python's start and imports; peak memory in bytes where Linux tells it.
    figures["seconds"] = time.perf_counter() - start
    figures["cpu_seconds"] = time.process_time() - cpu
    figures["peak_bytes"] = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(json.dumps(figures, indent=1))


main(sys.argv[1])
