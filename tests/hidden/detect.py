#!/usr/bin/env python3
"""Tests the detection limits: matched statistics of sets with effects at their limit must be 5.

    detect.py [--draws 8] [--first 1] [KIND ...]

Each statistic is written out here and gathers all stacks as the limit's formula does; base parameters are known.
Its mean over the draws must be 5 within four standard errors. Takes about a minute.
"""
import argparse
import sys

import numpy as np

import generate
from check import planes
from estimates import Frames, floored
from readout import MeanShift

SIZE = (128, 128)


def each_stack(f):
    """Frames and variance of every stack, by the base model."""
    for s, v, mu in zip(f.w.stacks, f.w.info.var[:, 0], f.w.info.mu[:, 0]):
        yield s, f[s.id], v, mu


def gathered(parts):
    """Combines estimates of an amount by their information: the best mean over its standard deviation."""
    x, information = np.array(list(parts)).T
    return np.sum(x * information) / np.sqrt(np.sum(information))


def means(f):
    i = f.w.info
    seen = np.array([[p.mean() for p in planes(f[s.id], i.planes)] for s in f.w.stacks])
    dark, _ = floored(f.c.dark_e_per_s, f.c.dsnu_e_per_s)
    return abs(i.means(f.effect.shift(), f.effect.open_to(), seen - i.mu - i.warm_t[:, None] * dark))


def shared(axis):
    """Variance component of frames averaged over `axis`."""
    def statistic(f):
        for s, x, v, _ in each_stack(f):
            r = (x - x.mean(0)).mean(axis)
            m, groups = x.size / r.size, r[0].size
            dof = (s.frames - 1) * groups
            yield np.sum(r**2) / dof - v / m, dof / 2 * (m / v) ** 2
    return lambda f: gathered(statistic(f))


def offset_map(f):
    """The best map of offsets, with row means removed."""
    weights, variance = f.w.info.offset_weights()
    dark = [x.mean(0) for s, x, _, _ in each_stack(f) if s.role == "dark"]
    m = np.tensordot(weights, dark, 1)
    return m - m.mean(1, keepdims=True), variance * (1 - 1 / m.shape[1])


def gain_map(f):
    total, weight = 0, 0
    for s, x, v, mu in each_stack(f):
        w = s.frames * mu * mu / v
        if mu:
            total, weight = total + w * (x.mean(0) / mu - 1), weight + w
    return total / weight - np.mean(total / weight), 1 / weight + f.c.prnu**2


def component(map_and_variance, axis=None):
    m, v = map_and_variance
    r = m if axis is None else m.mean(axis)
    v = v if axis is None else v / m.shape[axis]
    return (np.sum((r - r.mean()) ** 2) / (r.size - 1) - v) / (v * np.sqrt(2 / r.size))


def pattern(f, map_and_variance):
    m, v = map_and_variance
    return np.mean(m * np.broadcast_to(f.effect.pattern, m.shape)) / np.sqrt(v / m.size)


def fall_off(f):
    pattern, (m, v) = f.effect.r2 - f.effect.r2.mean(), gain_map(f)
    return -np.sum(m * pattern) / np.sqrt(v * np.sum(pattern**2))


def read_noise(f):
    def statistic():
        for s, x, v, _ in each_stack(f):
            slope = 2 * f.c.read_e**2 / v
            yield (x.var(0, ddof=1).mean() / v - 1) / slope, slope**2 * (s.frames - 1) * x[0].size / 2
    return abs(gathered(statistic()))


def gain(f):
    def statistic():
        for s, x, v, mu in each_stack(f):
            if mu:
                shot = x.var(0, ddof=1).mean() - (v - mu)
                yield shot / x.mean() - 1, (mu / v) ** 2 * (s.frames - 1) * x[0].size / 2
    return abs(gathered(statistic()))


def coupling(f):
    def statistic():
        for s, x, v, mu in each_stack(f):
            x = x - x.mean(0)
            for product in (x[:, 1:] * x[:, :-1], x[:, :, 1:] * x[:, :, :-1]):
                share = (s.frames - 1) / s.frames
                yield product.mean() / share / (2 * mu) if mu else 0.0, product.size * share * (2 * mu / v) ** 2
    return gathered(statistic())


def flicker(f):
    def statistic():
        for s, x, v, mu in each_stack(f):
            if mu:
                m, known = x.mean((1, 2)) / mu, mu * mu / v * x[0].size
                yield m.var(ddof=1) - 1 / known, (s.frames - 1) / 2 * known**2
    return gathered(statistic())


STATISTICS = {
    **{k: means for k, e in generate.CATALOGUED.items() if issubclass(e, MeanShift)},
    "row-temporal-noise": shared(2), "column-temporal-noise": shared(1),
    "column-offset-fpn": lambda f: component(offset_map(f), 0), "pixel-offset-fpn": lambda f: component(offset_map(f)),
    "readout-channel-mismatch": lambda f: pattern(f, (gain_map if f.effect.parameter == "gain" else offset_map)(f)),
    "column-gain-fpn": lambda f: component(gain_map(f), 0), "prnu-low-frequency": lambda f: pattern(f, gain_map(f)),
    "relative-illumination": fall_off, "read-noise": read_noise, "system-gain": gain, "charge-coupling": coupling, "light-flicker": flicker,
    "outside-spokes": lambda f: pattern(f, gain_map(f)), "outside-gain-rectangle": lambda f: pattern(f, gain_map(f)),
}


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("kinds", nargs="*", default=list(STATISTICS), metavar="KIND")
    p.add_argument("--draws", type=int, default=8)
    p.add_argument("--first", type=int, default=1, help="first draw")
    a = p.parse_args()
    failed = 0
    for kind in a.kinds:
        z = []
        for draw in range(a.first, a.first + a.draws):
            cfa = "GRBG" if generate.KINDS[kind].needs_cfa else "mono"
            world, (effect,), sensor = generate.build(draw, [(kind, None)], 1, SIZE, cfa=cfa)
            z.append(STATISTICS[kind](Frames(world, effect, sensor)))
        wrong = abs(np.mean(z) - 5) > 4 * max(1, np.std(z)) / np.sqrt(len(z))
        failed += wrong
        print(f"{kind:28} {np.mean(z):6.2f}, scatter {np.std(z):.2f}{'  FAILED' if wrong else ''}", flush=True)
    print(f"{failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
