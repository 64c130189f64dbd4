"""Peers of the field-varying blur: the same tiles, nodes and kernels in scipy.fft, scipy.signal, OpenCV and
regularizepsf.

`benches/peers/optics` sets up Python, lets the bench write its inputs, its own answer and its time
(1024 x 1024 cells, one band), and runs this on the same machine right after. Threads: OMP_NUM_THREADS,
default 2. Prints the least wall time and the mean processor time of all threads (on a busy machine the one to
look at), as ratios to the bench's, and the largest difference from its answer over the peak.
"""

import json
import os
import sys
import time

import numpy as np
import scipy.fft as fft
import scipy.signal as signal

THREADS = int(os.environ.get("OMP_NUM_THREADS", "2"))


def tiles(job, image, kernels):
    """Every tile with its four weights and kernels."""
    side, tile, size = job["side"], job["tile"], job["kernel"]
    count = -(-side // tile)
    fraction = ((np.arange(tile) + 0.5) / tile).astype(np.float32)
    for j in range(count):
        for i in range(count):
            part = image[j * tile : (j + 1) * tile, i * tile : (i + 1) * tile]
            v = fraction[: part.shape[0], None]
            t = fraction[None, : part.shape[1]]
            corner = j * (count + 1) + i
            nodes = [corner, corner + 1, corner + count + 1, corner + count + 2]
            weights = [(1 - v) * (1 - t), (1 - v) * t, v * (1 - t), v * t]
            yield j * tile, i * tile, [(part * w, kernels[n]) for w, n in zip(weights, nodes)]


def blur(job, image, kernels, convolve):
    side, size = job["side"], job["kernel"]
    out = np.zeros((side + size - 1, side + size - 1), np.float32)
    for y, x, parts in tiles(job, image, kernels):
        light = convolve(parts)
        out[y : y + light.shape[0], x : x + light.shape[1]] += light
    before = job["before"]
    return out[before : before + side, before : before + side]


def by_scipy_fft(parts):
    """The scheme of the engine: four products, one inverse."""
    (h, w), (k, _) = parts[0][0].shape, parts[0][1].shape
    shape = (fft.next_fast_len(h + k - 1, True), fft.next_fast_len(w + k - 1, True))
    total = 0
    for light, kernel in parts:
        total = total + fft.rfft2(light, shape, workers=THREADS) * fft.rfft2(
            kernel, shape, workers=THREADS
        )
    return fft.irfft2(total, shape, workers=THREADS)[: h + k - 1, : w + k - 1]


def by_fftconvolve(parts):
    return sum(signal.fftconvolve(light, kernel) for light, kernel in parts)


def by_opencv(cv2):
    cv2.setNumThreads(THREADS)

    def convolve(parts):
        total = 0
        for light, kernel in parts:
            pad = kernel.shape[0] - 1
            padded = cv2.copyMakeBorder(light, pad, pad, pad, pad, cv2.BORDER_CONSTANT, value=0)
            full = cv2.filter2D(
                padded, cv2.CV_32F, kernel[::-1, ::-1], borderType=cv2.BORDER_CONSTANT
            )
            half = pad // 2
            total = total + full[half : full.shape[0] - half, half : full.shape[1] - half]
        return total

    return convolve


def by_regularizepsf(job, image, kernels):
    """Its own scheme: overlapping windowed patches, one PSF each; so its answer differs, and only time counts."""
    from regularizepsf import ArrayPSF, ArrayPSFTransform
    from regularizepsf.util import IndexedCube, calculate_covering

    patch, size, tile = 256, job["kernel"], job["tile"]
    count = -(-job["side"] // tile)
    places = [tuple(place) for place in calculate_covering(image.shape, patch)]

    def cube(kernel_at):
        values = np.zeros((len(places), patch, patch))
        start = patch // 2 - size // 2
        for value, (row, column) in zip(values, places):
            j, i = (min(max(round((x + patch / 2) / tile), 0), count) for x in (row, column))
            value[start : start + size, start : start + size] = kernel_at(j * (count + 1) + i)
        return IndexedCube(places, values)

    point = np.zeros((size, size))
    point[size // 2, size // 2] = 1
    source, target = ArrayPSF(cube(lambda _: point)), ArrayPSF(cube(lambda node: kernels[node]))
    transform = ArrayPSFTransform.construct(source, target, alpha=1.0, epsilon=0.0)
    image = image.astype(float)
    return lambda: transform.apply(image, workers=THREADS)


def main():
    folder = sys.argv[1]
    with open(os.path.join(folder, "job.json")) as file:
        job = json.load(file)
    side, size = job["side"], job["kernel"]
    load = lambda name: np.fromfile(os.path.join(folder, name), "<f4")
    image = load("image.f32").reshape(side, side)
    kernels = load("kernels.f32").reshape(-1, size, size)
    ours = load("ours.f32").reshape(side, side)
    def tiled(convolve):
        def run():
            with fft.set_workers(THREADS):
                return blur(job, image, kernels, convolve)

        return run

    methods = {
        "scipy.fft, same scheme": tiled(by_scipy_fft),
        "scipy.signal.fftconvolve x 4": tiled(by_fftconvolve),
    }
    try:
        import cv2

        methods["OpenCV filter2D x 4"] = tiled(by_opencv(cv2))
    except ImportError as error:
        print(f"SKIP: OpenCV filter2D: {error}")
    try:
        methods["regularizepsf"] = by_regularizepsf(job, image, kernels)
    except ImportError as error:
        print(f"SKIP: regularizepsf: {error}")
    ours_wall, ours_processor = job["seconds"], job["processor"]
    print(f"camrig: {ours_wall:.4f} s wall, {ours_processor:.4f} s processor")
    runs = 8
    for name, run in methods.items():
        run()
        walls, before = [], time.process_time()
        for _ in range(runs):
            start = time.perf_counter()
            out = run()
            walls.append(time.perf_counter() - start)
        processor = (time.process_time() - before) / runs
        error = np.abs(out - ours).max() / ours.max()
        print(
            f"{name}: {min(walls):.4f} s wall ({min(walls) / ours_wall:.1f} of camrig's), "
            f"{processor:.4f} s processor ({processor / ours_processor:.1f} of camrig's), "
            f"difference {error:.1e} of peak"
        )


if __name__ == "__main__":
    main()
