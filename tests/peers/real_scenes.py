"""Mean DN that real reflectance scenes should give, computed with NumPy from closed forms alone.

    python3 real_scenes.py DATA     (the folder with scenes/, sensors/, illuminants/, photometry/)

Prints the figures of `real_scenes_have_the_means_of_closed_forms` in tests/tests/suite/real_data.rs: the sensor of the
preset mt9t012 cut to 160 x 120 pixels, RGGB, with the quantum efficiency of the MT9V024 and no IR cut,
20 ms under D65, whose table ends at 830 nm, at 300 lx. Equation numbers are those of Chen et al. 2009. Left out: blur (which moves light
over a few pixels and leaves the mean) and noise (whose mean is zero).
"""

import csv
import pathlib
import sys

import numpy as np

WIDTH, HEIGHT, PITCH_M, FILL_FACTOR = 160, 120, 2.2e-6, 0.8
F_NUMBER, FOCAL_MM, TRANSMITTANCE = 2.8, 4.9, 0.92
EXPOSURE_S, LUX = 0.020, 300.0
FULL_WELL_E, MAX_DN, BLACK_DN, DARK_E_PER_S = 6500.0, 1023.0, 42.0, 20.0
PLANCK_J_S, LIGHT_M_PER_S, EFFICACY_LM_PER_W = 6.62607015e-34, 299792458.0, 683.002


def table(path):
    rows = [row for row in csv.reader(path.open()) if not row[0].startswith("#")]
    return np.array([[float(v) for v in row] for row in rows[1:]]).T


def pixel_means(image):
    """Means over the photosensitive square of each pixel; the scene fills the frame's width."""
    rows, columns = image.shape
    cell = columns / WIDTH
    top = (rows - HEIGHT * cell) / 2
    integral = np.zeros((rows + 1, columns + 1))
    integral[1:, 1:] = image.cumsum(0).cumsum(1)

    def up_to(y, x):
        y, x = np.clip(y, 0, rows), np.clip(x, 0, columns)
        y0, x0 = np.minimum(y.astype(int), rows - 1), np.minimum(x.astype(int), columns - 1)
        fy, fx = (y - y0)[:, None], (x - x0)[None]
        at = lambda a, b: integral[np.ix_(a, b)]
        above = (1 - fx) * at(y0, x0) + fx * at(y0, x0 + 1)
        below = (1 - fx) * at(y0 + 1, x0) + fx * at(y0 + 1, x0 + 1)
        return (1 - fy) * above + fy * below

    half = np.sqrt(FILL_FACTOR) / 2
    y = [top + (np.arange(HEIGHT) + 0.5 + side) * cell for side in (-half, half)]
    x = [(np.arange(WIDTH) + 0.5 + side) * cell for side in (-half, half)]
    sums = up_to(y[1], x[1]) - up_to(y[0], x[1]) - up_to(y[1], x[0]) + up_to(y[0], x[0])
    return sums / (2 * half * cell) ** 2


def means(data, cube, band_nm, first_nm, last_nm):
    """Mean DN of red, green and blue; light from `first_nm` to `last_nm` counts."""
    nm = np.arange(first_nm + 0.5, last_nm)
    light = table(data / "illuminants/D65.csv")
    luminous = table(data / "photometry/V_lambda.csv")
    visible = np.arange(360, 831)
    power = np.interp(visible, *light)
    lumens = EFFICACY_LM_PER_W * np.sum(power * np.interp(visible, *luminous, left=0, right=0))
    white = LUX / np.pi / lumens * np.interp(nm, *light, right=0)  # radiance, W/(m2 sr nm)
    irradiance = np.pi * TRANSMITTANCE * white / (1 + 4 * F_NUMBER**2)  # eq. 7 at infinity
    photons_per_j = nm * 1e-9 / (PLANCK_J_S * LIGHT_M_PER_S)
    qe = table(data / "sensors/onsemi_aptina_MT9V024_RGB.csv")
    to_bands = np.array([np.interp(nm, band_nm, unit) for unit in np.eye(len(band_nm))])
    x, y = ((np.arange(n) + 0.5 - n / 2) * PITCH_M * 1e3 for n in (WIDTH, HEIGHT))
    cos4 = (FOCAL_MM**2 / (FOCAL_MM**2 + x[None] ** 2 + y[:, None] ** 2)) ** 2
    frames = []
    for curve in qe[1:]:
        per_nm = irradiance * photons_per_j * np.interp(nm, qe[0], curve)  # eq. 8, 9
        electrons = pixel_means((cube.astype(float) * (to_bands @ per_nm)).sum(-1)) * cos4
        electrons *= PITCH_M**2 * FILL_FACTOR * EXPOSURE_S
        electrons += DARK_E_PER_S * EXPOSURE_S
        frames.append(BLACK_DN + electrons * MAX_DN / FULL_WELL_E)  # eq. 11
    red, green, blue = frames
    green = np.concatenate([green[0::2, 1::2], green[1::2, 0::2]])
    return [round(float(v.mean()), 2) for v in (red[0::2, 0::2], green, blue[1::2, 1::2])]


def main():
    data = pathlib.Path(sys.argv[1])
    # 156 bands from 401 to 889 nm are held as whole bands of 10 nm.
    samson = np.load(data / "scenes/samson_hyperspectral_95x95.npz")
    print("samson", means(data, samson["cube156"], samson["wavelength156_nm"], 405, 885))
    fruit = np.load(data / "scenes/fruitmcc_estimated_reflectance_316x338x31.npz")
    print("fruit", means(data, fruit["reflectance"], fruit["wavelength_nm"], 395, 705))


main()
