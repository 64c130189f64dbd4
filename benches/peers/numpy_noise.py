"""The sensor stage of benches/sensor.rs with numpy's Generator: prints millions of pixels per second.

Fixed patterns are made beforehand and not timed, which favours this side.
"""

import sys
import time

import numpy as np

width, height = int(sys.argv[1]), int(sys.argv[2])
rng = np.random.default_rng(1)
means = np.tile(1 + 8000 * np.arange(width) / width, (height, 1))
gain = 1 + 0.008 * rng.standard_normal((height, width))
dark = np.maximum(0.02 * (20 + 5 * rng.standard_normal((height, width))), 0)
rows = 0.8 * rng.standard_normal((height, 1))


def frame():
    charge = rng.poisson(means) * gain + rng.poisson(dark)
    signal = np.minimum(charge, 10_000) + rows + 3 * rng.standard_normal(means.shape)
    return np.clip(np.rint(signal * (4095 / 10_000) + 64), 0, 4095).astype(np.uint16)


best = min((lambda t: (frame(), time.perf_counter() - t)[1])(time.perf_counter()) for _ in range(5))
print(width * height / best / 1e6)
