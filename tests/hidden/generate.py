#!/usr/bin/env python3
"""Hides effects in a simulated capture set, for `camrig diagnose` to find. Independent of camrig: numpy only.

Writes OUT/camera.toml (the base model, without what is hidden), OUT/captures.toml, frames, and beside it
OUT-truth.json. Example:

    generate.py /tmp/set --effects row-temporal-noise --times 3
    generate.py /tmp/set --effects nonlinearity=0.01,hot-pixels=0.001 --draw 7 --design full
    generate.py /tmp/set --effects random:2 --cfa GRBG
"""
import argparse
import json
import pathlib
import secrets
import sys

import numpy as np

import defects
import light
import outside
import readout
from camera import camera_files, captures_toml, design, draw, stream
from limits import Information
from sensor import Sensor

CATALOGUED = {e.kind: e for e in readout.EFFECTS + light.EFFECTS + defects.EFFECTS}
OUTSIDE = {e.kind: e for e in outside.EFFECTS}
KINDS = CATALOGUED | OUTSIDE
SIZES = {"small": (256, 256), "full": (512, 384)}


class World:
    """What an effect may use: the base camera, the captures and their detection limits."""

    def __init__(self, camera, stacks):
        self.camera, self.stacks = camera, stacks
        self.info = Information(camera, stacks)
        self.width, self.height = camera.width, camera.height
        self.x, self.y = np.arange(self.width)[None, :], np.arange(self.height)[:, None]


def possible(cfa, kinds=CATALOGUED):
    """Kinds that frames under this filter array can show."""
    return [k for k, e in kinds.items() if cfa != "mono" or not e.needs_cfa]


def build(seed, effects, times, size=(256, 256), design_name="small", cfa="mono"):
    """World, hidden effects with their amounts, and sensor.

    `effects`: pairs of kind and amount, or None for `times` (one for all, or one each) detection limits.
    """
    camera = draw(stream(seed, "camera"), *size, cfa)
    world = World(camera, design(camera, design_name))
    hidden = []
    for (kind, amount), multiple in zip(effects, np.broadcast_to(times, len(effects))):
        effect = KINDS[kind](world, stream(seed, "effect", kind))
        effect.amount = float(multiple * effect.limit() if amount is None else amount)
        hidden.append(effect)
    return world, hidden, Sensor(camera, hidden, seed)


def truth(seed, hidden):
    """The hidden effects, for the scorer only."""
    plain = lambda d: {k: v if isinstance(v, (int, str)) else float(v) for k, v in d.items()}
    return {"draw": seed, "effects": [
        {"kind": e.kind, "catalogued": e.catalogued, "limit": float(e.limit()), "times": e.amount / float(e.limit()),
         "sd": None if e.sd() is None else float(e.sd()), "parameter": e.parameter,
         "parameters": plain({e.parameter: e.amount} | e.details())} for e in hidden]}


def write(out, world, sensor):
    """The set: camera file, manifest, frames."""
    out = pathlib.Path(out)
    out.mkdir(parents=True)
    for name, text in camera_files(world.camera).items():
        (out / name).write_text(text)
    (out / "captures.toml").write_text(captures_toml(world.camera, world.stacks))
    for stack in world.stacks:
        np.save(out / f"{stack.id}.npy", sensor.frames(stack))


def read_effects(text, seed, cfa):
    """`none`, `random[:N]`, or KIND[=AMOUNT],... to pairs."""
    if text == "none":
        return []
    if text.partition(":")[0] == "random":
        count = int(text.partition(":")[2] or 1)
        return [(str(k), None) for k in stream(seed, "kinds").choice(possible(cfa), count, replace=False)]
    pairs = [part.partition("=") for part in text.split(",")]
    for kind, _, _ in pairs:
        if kind not in KINDS:
            sys.exit(f"unknown kind {kind!r}; known: {', '.join(KINDS)}")
        if cfa == "mono" and KINDS[kind].needs_cfa:
            sys.exit(f"{kind} shows only under a filter array: add --cfa GRBG")
    return [(kind, float(amount) if amount else None) for kind, _, amount in pairs]


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("out", help="folder to be made")
    p.add_argument("--effects", default="none", help="none, random[:N], or KIND[=AMOUNT],...")
    p.add_argument("--draw", type=int, help="seed; default: from the operating system")
    p.add_argument("--times", type=float, default=10.0, help="amount in detection limits where none is given")
    p.add_argument("--size", help="WxH; default: that of the design")
    p.add_argument("--design", choices=SIZES, default="small")
    p.add_argument("--cfa", choices=["mono", "GRBG"], default="mono")
    a = p.parse_args()
    seed = secrets.randbits(32) if a.draw is None else a.draw
    size = tuple(map(int, a.size.split("x"))) if a.size else SIZES[a.design]
    if min(size) < 32 or size[0] % 2 or size[1] % 2:
        sys.exit(f"--size {a.size}: width and height are even and at least 32")
    out = pathlib.Path(a.out)
    world, hidden, sensor = build(seed, read_effects(a.effects, seed, a.cfa), a.times, size, a.design, a.cfa)
    write(out, world, sensor)
    out.with_name(out.name + "-truth.json").write_text(json.dumps(truth(seed, hidden), indent=1) + "\n")
    print(f"{out}: draw {seed}")


if __name__ == "__main__":
    main()
