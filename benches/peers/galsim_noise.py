"""Shot noise, read noise and quantisation with GalSim's CCDNoise: prints millions of pixels per second.

No dark current, no patterns: less work than benches/sensor.rs does.
"""

import sys
import time

import galsim
import numpy as np

width, height = int(sys.argv[1]), int(sys.argv[2])
means = np.tile(1 + 8000 * np.arange(width) / width, (height, 1)).astype(np.float32)
noise = galsim.CCDNoise(galsim.BaseDeviate(1), gain=1.0, read_noise=3.0)


def frame():
    image = galsim.Image(means.copy())
    image.addNoise(noise)
    image *= 4095 / 10_000
    image += 64
    image.quantize()
    return np.clip(image.array, 0, 4095).astype(np.uint16)


best = min((lambda t: (frame(), time.perf_counter() - t)[1])(time.perf_counter()) for _ in range(5))
print(width * height / best / 1e6)
