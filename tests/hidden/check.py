#!/usr/bin/env python3
"""Checks the generator: base statistics against closed forms, and every effect measured from its frames.

    check.py [--draw N] [--times 10] [KIND ...]

Each line is an estimate from the frames, what the truth says, and their difference in standard deviations. All
must lie within 4.5 (one false alarm in some 1500 runs). Exit status 1 where one does not.
"""
import argparse
import sys
import tempfile
import tomllib

import numpy as np

import generate
from camera import WAVELENGTHS, draw, stream
from estimates import ESTIMATES, Frames, floored
from lens import Lens, electrons_per_lux_s, image, pupil_transfer

LIMIT = 4.5
SIZE = (128, 128)


def planes(x, number):
    """The colour planes of frames."""
    return [x] if number == 1 else [x[:, i::2, j::2] for i in (0, 1) for j in (0, 1)]


def base(seed, cfa):
    """Mean and variance of every stack, and the fixed patterns, of a sensor with nothing hidden."""
    world, _, sensor = generate.build(seed, [], 0, SIZE, cfa=cfa)
    f, c, pixels = Frames(world, None, sensor), world.camera, SIZE[0] * SIZE[1]
    floor = c.read_e**2 + 1 / (12 * c.gain**2)
    dark, dark_sd = floored(c.dark_e_per_s, c.dsnu_e_per_s)
    for s in world.stacks:
        t = s.exposure_s * 2 ** ((s.temperature_c - 25) / c.doubling_c)
        photons = s.irradiance * s.exposure_s * (c.pitch_um * 1e-6) ** 2 * s.wavelength_nm * 1e-9 / 1.98644586e-25
        mu = photons * c.fill_factor * np.mean([c.qe(p)[max(s.wavelength_nm - 400, 0) // 10] for p in c.planes])
        sd = np.sqrt((floor + mu + dark * t) / s.frames / pixels + (mu * c.prnu) ** 2 / pixels
                     + (c.dsnu_e_per_s * t) ** 2 / pixels + c.row_fpn_e**2 / SIZE[1])
        yield f"{cfa} {s.id} mean", f.mean(s.id), mu + dark * t, sd
        v = floor + mu * (1 + c.prnu**2) + dark * t
        yield f"{cfa} {s.id} variance", f.pixel_variance(s.id).mean(), v, v * np.sqrt(2 / (s.frames - 1) / pixels) * (
            1.2 if cfa != "mono" else 1)
    i = world.info
    means = np.array([[plane.mean() for plane in planes(f[s.id], i.planes)] for s in world.stacks])
    off = (means - i.mu - i.warm_t[:, None] * dark).ravel()
    yield f"{cfa} means: chi2", off @ np.linalg.solve(i.covariance(), off), off.size, np.sqrt(2 * off.size)
    x = f.residual("dark-short")
    v = f.pixel_variance("dark-short").mean()
    for name, product in (("row", x[:, :, 1:] * x[:, :, :-1]), ("column", x[:, 1:] * x[:, :-1]), ("frame", x[1:] * x[:-1])):
        expected = -v / 32 if name == "frame" else 0.0
        yield f"{cfa} lag 1 along {name}", product.mean(), expected, v / np.sqrt(product.size)
    slope, noise = f.dark_slope()
    yield f"{cfa} dsnu", slope.var(), noise + dark_sd**2, slope.var() * np.sqrt(2 / pixels)
    rows = f["dark-short"].mean((0, 2))
    yield f"{cfa} row fpn", rows.var(ddof=1), c.row_fpn_e**2 + v / 32 / SIZE[0], rows.var() * np.sqrt(2 / SIZE[1])
    if cfa == "mono":
        gain, expected = f.gain()
        yield f"{cfa} prnu", gain.var(), expected, gain.var() * np.sqrt(2 / pixels)


def effects(seed, times, kinds):
    """Every effect at `times` its limit, measured from the frames."""
    for kind in kinds:
        cfa = "GRBG" if generate.KINDS[kind].needs_cfa else "mono"
        world, (effect,), sensor = generate.build(seed, [(kind, None)], times, SIZE, cfa=cfa)
        yield kind, *ESTIMATES[kind](Frames(world, effect, sensor))


def files(seed):
    """The written set states what was simulated, and nothing about what is hidden."""
    with tempfile.TemporaryDirectory() as folder:
        out = f"{folder}/set"
        built = generate.build(seed, [("system-gain", None), ("row-temporal-noise", None)], 10, (32, 32))
        generate.write(out, built[0], built[2])
        with open(f"{out}/camera.toml", "rb") as t:
            sensor = tomllib.load(t)["sensor"]
        with open(f"{out}/captures.toml", "rb") as t:
            captures = tomllib.load(t)["capture"]
        c = built[0].camera
        written = [4095 / sensor["full_well_e"], sensor["noise"]["read_e"], sensor["black_level_dn"]]
        yield "camera file", float(np.abs(np.subtract(written, [c.gain, c.read_e, c.black_dn])).max()), 0.0, 1e-12
        stack = next(s for s in built[0].stacks if s.id == captures[-1]["id"])
        read = np.load(f"{out}/{captures[-1]['files']}")
        yield "frames", float(np.abs(read.astype(int) - built[2].frames(stack)).max()), 0.0, 1e-12


def lenses(seed):
    """Images of the lens by closed forms. There is no noise: the last figure is the accuracy of the cells, and for
    positions of dots 1 %, the error of a window of whole pixels."""
    x = 0.3
    yield "pupil in focus", float(pupil_transfer(x, 0.0)), 2 / np.pi * (np.arccos(x) - x * np.sqrt(1 - x * x)), 1e-12
    c = draw(stream(seed, "camera"), 200, 100, "mono")   # whole periods of the dots, 10 pixels
    white = np.sum(electrons_per_lux_s(c, Lens())["mono"])
    covered = np.pi * 0.0125**2 / 0.05**2
    yield "dots: mean", image(c, Lens(), "dots").mean() / white, 0.8 - 0.76 * covered, 1e-4
    far = 80.0   # pixels from the centre to a dot along the row

    def place(lens):
        window = image(c, lens, "dots")[45:55, 175:185]
        window = (window[:, 0] + window[:, -1]).mean() / 2 - window   # the dots around do not count
        return np.sum(window * (np.arange(175, 185) + 0.5 - 100)) / window.sum() - far

    r = far / np.hypot(100, 50)
    yield "dots: distortion", place(Lens(k1=-0.01)), far * -0.01 * r**2, 4e-3
    yield "dots: size", place(Lens(size=1.005)), far * 0.005, 4e-3
    apart = place(Lens(k1=-0.01, x_px=-20.0)) / place(Lens(k1=-0.01))
    yield "dots: axis", apart, ((far + 20) / far) ** 3, 0.01 * apart
    yield "dots: lateral colour", place(Lens(blue_px=0.4, red_px=0.4)) / place(Lens(size=1 + 0.4 / np.hypot(100, 50))), \
        spread_of_lamp(c), 5e-3
    dark = [image(c, lens, "slanted-edge")[:, :20].mean() / white for lens in (Lens(), Lens(glare=0.1))]
    yield "edge: glare", dark[1], 0.9 * dark[0] + 0.1 * 0.5, 1e-4


def spread_of_lamp(c):
    """Mean distance of the light from 550 nm, over 100 nm and at most 1."""
    e = electrons_per_lux_s(c, Lens())["mono"]
    return np.sum(e * np.clip(np.abs(WAVELENGTHS - 550) / 100, 0, 1)) / e.sum()


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("kinds", nargs="*", default=list(ESTIMATES), metavar="KIND")
    p.add_argument("--draw", type=int, default=1)
    p.add_argument("--times", type=float, default=10)
    a = p.parse_args()
    for kind in set(a.kinds) - set(ESTIMATES):
        sys.exit(f"unknown kind {kind!r}; known: {', '.join(ESTIMATES)}")
    assert set(ESTIMATES) == set(generate.KINDS)
    failed = 0
    tests = [*files(a.draw), *lenses(a.draw), *base(a.draw, "mono"), *base(a.draw, "GRBG")] if len(a.kinds) == len(ESTIMATES) else []
    for name, estimate, expected, sd in [*tests, *effects(a.draw, a.times, a.kinds)]:
        z = (estimate - expected) / sd
        failed += not abs(z) < LIMIT
        print(f"{name:32} {estimate:13.6g} {expected:13.6g} +- {sd:9.3g}  {z:+6.2f}{'' if abs(z) < LIMIT else '  FAILED'}")
    print(f"{failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
