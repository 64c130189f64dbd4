"""Renders three frames with Mitsuba 3 into a folder, and says by a file `end` that there are no more.

    mitsuba_frames.py FOLDER [rgb | spectral]            pictures of red, green and blue, or of 31 bands
    mitsuba_frames.py FOLDER (rgb | spectral) FRAMES.PY  also the same samples, as camrig-frames/1, on standard output

A still card of reflectance 0.5 and a red one that moves to the right by 0.3 of a unit a frame, under a constant light of
radiance 1, before which nothing else stands: what is seen of them is their reflectance.
"""

import importlib.util
import os
import sys

import mitsuba as mi
import numpy as np

folder, kind = sys.argv[1], (sys.argv[2:] or ["rgb"])[0]
mi.set_variant(f"scalar_{kind}")
T = mi.ScalarTransform4f
BANDS = range(400, 701, 10)


def card(x, reflectance):
    return {
        "type": "rectangle",
        "to_world": T().translate([x, 0, 0]).scale(0.6),
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": reflectance}},
    }


def film():
    shared = {"width": 64, "height": 48, "rfilter": {"type": "box"}}
    if kind == "rgb":
        return {"type": "hdrfilm", **shared}
    box = lambda nm: {"type": "regular", "wavelength_min": nm - 5.0, "wavelength_max": nm + 5.0, "values": "1, 1"}
    return {"type": "specfilm", **shared, **{f"b{nm}": box(nm) for nm in BANDS}}


stream = None
if sys.argv[3:]:
    spec = importlib.util.spec_from_file_location("frames", sys.argv[3])
    stream = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(stream)
for frame in range(3):
    light = {"type": "rgb", "value": 1.0} if kind == "rgb" else {"type": "uniform", "value": 1.0}
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 2},
            "light": {"type": "constant", "radiance": light},
            "still": card(-1.0, [0.5, 0.5, 0.5]),
            "moving": card(0.6 + 0.3 * frame, [0.8, 0.2, 0.1]),
            "sensor": {
                "type": "perspective",
                "fov": 45,
                "to_world": T().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0]),
                "film": film(),
                "sampler": {"type": "independent", "sample_count": 64},
            },
        }
    )
    names = [f"S0.{nm},000000nm" for nm in BANDS] if kind == "spectral" else []
    picture = mi.Bitmap(mi.render(scene, seed=frame), channel_names=names)
    picture.write(os.path.join(folder, f"f{frame}.exr"))
    if stream:
        bands = None if kind == "rgb" else (31, 400.0, 10.0)
        # A box of 10 nm collects ten times the radiance per nm.
        scale = 100.0 if kind == "rgb" else 0.1
        samples = np.array(picture, dtype=np.float32).tobytes()
        message = stream.message(frame, frame * 40_000_000, 64, 48, samples, scale, bands=bands)
        sys.stdout.buffer.write(message)
open(os.path.join(folder, "end"), "w").close()
if stream:
    sys.stdout.buffer.write(stream.end(3, 120_000_000))
