"""Renders three frames with Mitsuba 3 into a folder, and says by a file `end` that there are no more.

A still card of reflectance 0.5 and a red one that moves to the right by 0.3 of a unit a frame, under a constant light of
radiance 1, before which nothing else stands: what is seen of them is their reflectance.
"""

import os
import sys

import mitsuba as mi

mi.set_variant("scalar_rgb")
folder = sys.argv[1]
T = mi.ScalarTransform4f


def card(x, reflectance):
    return {
        "type": "rectangle",
        "to_world": T().translate([x, 0, 0]).scale(0.6),
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": reflectance}},
    }


for frame in range(3):
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 2},
            "light": {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}},
            "still": card(-1.0, [0.5, 0.5, 0.5]),
            "moving": card(0.6 + 0.3 * frame, [0.8, 0.2, 0.1]),
            "sensor": {
                "type": "perspective",
                "fov": 45,
                "to_world": T().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": 64, "height": 48, "rfilter": {"type": "box"}},
                "sampler": {"type": "independent", "sample_count": 64},
            },
        }
    )
    mi.Bitmap(mi.render(scene, seed=frame)).write(os.path.join(folder, f"f{frame}.exr"))
open(os.path.join(folder, "end"), "w").close()
