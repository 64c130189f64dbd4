#!/usr/bin/env python3
"""Hides effects of the lens, or the four gaps of Chen et al. 2009 together, for `camrig diagnose` to find.

The sensor and its frames are those of `generate.py`, images are those of `lens.py`: neither shares code with camrig. The
set has an edge, a grid of dots, and a ColorChecker in good and in poor light beside the dark and flat stacks.

    tests/hidden/optics.py --camrig target/release/camrig --draws 3 --null 20
    tests/hidden/optics.py --only SET --kinds defocus,veiling-glare     # the set alone; what is hidden in SET-truth.json
"""

import argparse
import json
import pathlib
import secrets
import subprocess
import tempfile
from dataclasses import replace

import numpy as np

import generate
from camera import Stack, design, digits, draw, stream
from lens import CHARTS, Lens, exposure_for, image, lamp_csv
from sensor import Sensor

WIDTH, HEIGHT = 256, 192


# Amounts are drawn from a uniform distribution.
ALONE = {
    "defocus": {"shift_um": (5, 12)},
    "distortion": {"k1": (-0.03, -0.005)},
    "lens-transmittance": {"factor": (0.8, 0.97)},
    "veiling-glare": {"fraction": (0.01, 0.05)},
    "lateral-colour": {"blue_px": (0.3, 1.0), "red_px": (-1.0, -0.3)},
    "relative-illumination": {"corner": (0.05, 0.2)},
    "colour-shading": {"corner": (0.03, 0.1)},
    "optical-crosstalk": {"side": (0.004, 0.02)},
}
# The position of the axis shows only in effects that are centred on it.
DECENTRED = {
    "distortion": {"k1": (-0.05, -0.02)},
    "decentre-tilt": {"x_px": (4, 12), "y_px": (-12, -4)},
}
PAPER = {
    "defocus": {"shift_um": (7, 9)},
    "lens-transmittance": {"factor": (0.8, 0.9)},
    "distortion": {"k1": (-0.02, -0.01), "size": (0.99, 0.996)},
    "hot-pixels": {"fraction": (0.015, 0.025)},
    "row-temporal-noise": {"sigma_e": (1.0, 2.0)},
    "defective-pixels": {"fraction": (4e-4, 8e-4)},
}
TOGETHER = {"decentred": DECENTRED, "paper": PAPER}
IN_LENS = {"defocus", "distortion", "decentre-tilt", "lens-transmittance", "veiling-glare", "lateral-colour"}


def stacks(camera, plain):
    """Stacks of the small design, and scenes: behind the plain lens a reflectance of 0.8 is at 60 % of saturation at
    300 lx, and at 40 % at 10 lx."""
    bright = {"exposure_s": exposure_for(camera, plain, 0.6 * camera.saturation_e, 0.8, 300.0)}
    dim = {"exposure_s": digits(5 * bright["exposure_s"]), "analog_gain": 4.0}

    def look(id, role, frames=8, **more):
        return Stack(id, role, frames, electrons=(0.0,) * len(camera.planes), **more)

    return design(camera, "small") + [
        look("dark-10lx", "dark", **dim),
        look("edge", "edge", scene="slanted-edge", lux=300.0, **bright),
        look("dots", "dots", scene="dots", lux=300.0, **bright),
        look("chart-300lx", "chart", scene="colorchecker", lux=300.0, **bright),
        look("chart-10lx", "chart", scene="colorchecker", lux=10.0, **dim)]


def build(seed, kinds):
    """World and sensor of a set with these kinds (each with the ranges of its amounts); what is hidden."""
    camera = draw(stream(seed, "camera"), WIDTH, HEIGHT, "GRBG")
    world = generate.World(camera, design(camera, "small"))
    lens, effects, hidden = Lens(), [], {}
    for kind, ranges in kinds.items():
        rng = stream(seed, "optics", kind)
        amounts = hidden[kind] = {key: float(f"{rng.uniform(*span):.5g}") for key, span in ranges.items()}
        if kind in IN_LENS:
            lens = replace(lens, **{{"fraction": "glare"}.get(key, key): x for key, x in amounts.items()})
        else:
            effect = generate.KINDS[kind](world, rng)
            (effect.amount,) = amounts.values()
            hidden[kind] = {effect.parameter: effect.amount} | effect.details()
            effects.append(effect)
    images = {scene: image(camera, lens, scene) for scene in CHARTS}
    world.stacks = stacks(camera, Lens())
    return world, Sensor(camera, effects, seed, images), hidden


def write(out, world, sensor):
    """The set: camera file, lamp, manifest, frames."""
    generate.write(out, world, sensor)
    (pathlib.Path(out) / "lamp.csv").write_text(lamp_csv())


def diagnose(camrig, folder, seed, kinds):
    """The answer of `camrig diagnose` for a set, and what was hidden in it."""
    world, sensor, hidden = build(seed, kinds)
    write(f"{folder}/set", world, sensor)
    command = [camrig, "diagnose", f"{folder}/set/camera.toml", f"{folder}/set", "-o", f"{folder}/found"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise SystemExit(f"seed {seed}, {', '.join(kinds) or 'nothing'}: {done.stderr}")
    return json.loads(pathlib.Path(f"{folder}/found/diagnosis.json").read_text()), hidden


def row(name, answers):
    """A row of the table from all draws of a case."""
    exact = found = wrong = confirmed = near = known = 0
    others = set()
    for answer, hidden in answers:
        steps = {s["effect"]: s["parameters"] for s in answer["steps"]}
        exact += set(steps) == set(hidden)
        found += len(set(steps) & set(hidden))
        others |= set(steps) - set(hidden)
        wrong += len(set(steps) - set(hidden))
        confirmed += answer["verdict"] in ("explained", "agrees")
        for kind, amounts in hidden.items():
            for key, true in amounts.items():
                p = steps.get(kind, {}).get(key)
                if p and p["std_error"]:
                    known += 1
                    near += abs(abs(p["value"]) - abs(true)) <= 1.645 * p["std_error"]   # defocus has no sign
    gaps = [np.median([a[key] for a, _ in answers]) for key in ("gap_before", "gap_after")]
    total = sum(len(h) for _, h in answers)
    return (f"| {name} | {len(answers)} | {exact} | {found} of {total} | {wrong} {' '.join(sorted(others))} "
            f"| {gaps[0]:.2f} | {gaps[1]:.2f} | {confirmed} | {near} of {known} |")


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--camrig", default="target/release/camrig")
    p.add_argument("--draws", type=int, default=3, help="of each effect alone")
    p.add_argument("--null", type=int, default=20, help="of nothing hidden")
    p.add_argument("--together", type=int, default=1, help="of the paper's gaps, and of a decentred lens that distorts")
    p.add_argument("--seed", type=int, help="default: from the operating system")
    p.add_argument("--only", help="write one set there, and what is hidden beside it")
    p.add_argument("--kinds", default="", help="what the one set hides: kinds, `decentred` or `paper`")
    a = p.parse_args()
    seed = secrets.randbits(30) if a.seed is None else a.seed
    if a.only:
        kinds = TOGETHER.get(a.kinds) or {k: ALONE[k] for k in a.kinds.split(",") if k}
        world, sensor, hidden = build(seed, kinds)
        write(a.only, world, sensor)
        pathlib.Path(f"{a.only}-truth.json").write_text(json.dumps({"draw": seed, "effects": hidden}, indent=1) + "\n")
        return
    cases = [("nothing", {}, a.null), *((f"`{k}`", {k: v}, a.draws) for k, v in ALONE.items()),
             *((name, kinds, a.together) for name, kinds in TOGETHER.items())]
    print(f"seed {seed}\n\n| hidden | draws | exact set | named of it | wrong names | gap before | after | confirmed "
          "| parameters within 90 % |\n|---|---|---|---|---|---|---|---|---|", flush=True)
    for name, kinds, draws in cases:
        answers = []
        for i in range(draws):
            with tempfile.TemporaryDirectory(prefix="camrig-optics-") as folder:
                answers.append(diagnose(a.camrig, folder, int(stream(seed, name, i).integers(2**32)), kinds))
        if answers:
            print(row(name, answers), flush=True)


if __name__ == "__main__":
    main()
