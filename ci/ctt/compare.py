"""What rpi-ctt measured on simulated frames against the model: python3 compare.py CAMERA.toml TUNING.json CHART.dng

Black level and noise on ctt's 16-bit scale. Its noise model is std = slope sqrt(signal) + constant, fitted to
patches; the theory is std² = k signal + read², k in DN16 per electron. Its colour matrix (white balanced camera to
linear sRGB) at 6500 K is compared on the patches' own colours with the one in the chart's DNG.
"""

import json
import math
import sys
import tomllib

import exifread
import numpy as np

XYZ_TO_SRGB = np.array([[3.2409699, -1.5373832, -0.4986108], [-0.9692436, 1.8759675, 0.0415551],
                        [0.0556301, -0.2039770, 1.0569715]])


def rational(tag):
    return np.array([float(v.num) / float(v.den) for v in tag.values])


def lab(linear):
    xyz = np.linalg.solve(XYZ_TO_SRGB, linear) / np.linalg.solve(XYZ_TO_SRGB, np.ones(3))
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def main(camera_path, tuning_path, chart_path, patches_path):
    with open(camera_path, "rb") as file:
        sensor = tomllib.load(file)["sensor"]
    with open(tuning_path) as file:
        tuning = {name: value for part in json.load(file)["algorithms"] for name, value in part.items()}
    wrong = []

    def check(what, found, expected, tolerance):
        print(f"{what:34} ctt {found:10.4f}   model {expected:10.4f}")
        if abs(found - expected) > tolerance:
            wrong.append(f"{what}: {found} where the model has {expected} ± {tolerance}")

    shift = 1 << (16 - sensor["bits"])
    # ctt keeps whole DN of its scale.
    check("black level", tuning["rpi.black_level"]["black_level"], sensor["black_level_dn"] * shift, 0.5)
    k = ((1 << sensor["bits"]) - 1) / sensor["full_well_e"] * shift
    read = math.hypot(sensor["noise"]["read_e"] * k, shift / math.sqrt(12))
    # The line that fits the theory's square root where the chart has its patches.
    signal = np.linspace(0.03, 0.9, 50) * 65535
    slope, constant = np.polyfit(np.sqrt(signal), np.sqrt(k * signal + read ** 2), 1)
    # ctt writes 1.4 times the slope that it fitted. A patch of some hundred samples knows its standard deviation
    # to 5 %, two dozen patches the slope to 1 %.
    check("noise slope", tuning["rpi.noise"]["reference_slope"] / 1.4, slope, 0.03 * slope)
    print(f"{'noise constant':34} ctt {tuning['rpi.noise']['reference_constant']:10.4f}   model {constant:10.4f}")

    with open(chart_path, "rb") as file:
        tags = {tag.tag: tag for tag in exifread.process_file(file, details=False).values() if hasattr(tag, "tag")}
    matrix, neutral = rational(tags[0xC622]).reshape(3, 3), rational(tags[0xC628])
    ours = XYZ_TO_SRGB @ np.linalg.inv(matrix) @ np.diag(neutral)
    ours /= ours.sum(axis=1, keepdims=True)
    theirs = next(c["ccm"] for c in tuning["rpi.ccm"]["ccms"] if c["ct"] == 6500)
    theirs = np.array(theirs).reshape(3, 3)
    with open(patches_path) as file:
        measured = json.load(file)
    order = [measured["channels"].index(c) for c in "rgb"]
    camera = np.array([[p["mean_dn"][c]["value"] for c in order] for p in measured["patches"]]) / neutral
    camera /= camera[18].max()
    differences = [np.linalg.norm(lab(ours @ rgb) - lab(theirs @ rgb)) for rgb in camera]
    print(f"{'colour matrix, dE76 on 24 patches':34} mean {np.mean(differences):.2f}, max {np.max(differences):.2f}")
    print(f"  DNG: {np.round(ours, 3).tolist()}\n  ctt: {np.round(theirs, 3).tolist()}")
    # ctt fits to published sRGB values of the chart, the DNG to its reflectances: they agree to what
    # such tables differ by, about 3.
    if np.mean(differences) > 4:
        wrong.append(f"colour matrices differ by {np.mean(differences):.2f} on average")
    for line in wrong:
        print("FAILED:", line)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
