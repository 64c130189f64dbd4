"""Images of an edge, a grid of dots and a ColorChecker behind a lens: photo-electrons of every pixel. numpy only.

A chart of reflectance rho under `lux` has the radiance L = rho S lux / (pi 683 sum(S V)), the sensor the irradiance
E = pi L tau / (1 + 4 N^2). Charts are covered exactly on a grid of FINE cells to a pixel's side, with MARGIN pixels
around, where the lens's distortion takes it; blurred in the Fourier domain by the transfer function of a circular pupil
(Hopkins 1955) and of the square aperture of side pitch sqrt(fill); and read at the pixels' centres. Spectra are smooth,
so sums over their nodes, 10 nm apart, are integrals to some 1e-4; a lux meter's is over 1 nm, the lamp linear between.

Coordinates: (u, v), sensor widths right of and below the centre of the frame.
"""
import pathlib
from dataclasses import dataclass

import numpy as np

from camera import F_NUMBER, LIGHT_SPEED, PLANCK, WAVELENGTHS, digits

CRATES = pathlib.Path(__file__).resolve().parents[2] / "host/crates"   # of which CIE 1931, ColorChecker: facts
FINE, MARGIN = 5, 128
# The lamp has no light at the ends of the filter tables.
LAMP = np.round(np.sin(np.pi * np.clip((WAVELENGTHS - 410) / 280, 0, 1)) ** 2, 4)


def lamp_csv():
    """The lamp as a file."""
    return "wavelength_nm,power\n" + "".join(f"{w},{p:g}\n" for w, p in zip(WAVELENGTHS, LAMP))


def table(path):
    """Columns of a table of spectra, the first wavelengths."""
    lines = [line for line in (CRATES / path).read_text().splitlines() if not line.startswith("#")]
    return np.array([[float(x) for x in line.split(",")] for line in lines[1:]]).T


@dataclass(frozen=True)
class Lens:
    """A perfect lens and its possible faults. Lengths are in units of half the sensor's diagonal."""
    f_number: float = F_NUMBER
    shift_um: float = 0.0     # sensor out of focus
    size: float = 1.0         # of the image
    k1: float = 0.0           # real height = h (size + k1 r^2), r = h / corner, heights from the axis
    x_px: float = 0.0         # axis right of and below the centre of the frame, where the scene's stays
    y_px: float = 0.0
    blue_px: float = 0.0      # outward displacement in the corner at 450 nm, with that at 650 nm linear in wavelength
    red_px: float = 0.0
    factor: float = 1.0       # of the light that passes
    slope: float = 0.0        # its change per 100 nm from 550 nm
    glare: float = 0.0        # share of the light that lies evenly over the frame


def pupil_transfer(x, waves):
    """Transfer function of a circular pupil at x = f / cutoff, `waves` of defocus at its edge: the autocorrelation of
    exp(2 pi i waves rho^2), (4 / pi) times the integral of cos^2 t cos(8 pi waves x (sin t - x)) from asin x to pi / 2."""
    nodes, weights = np.polynomial.legendre.leggauss(96)
    low = np.arcsin(np.clip(x, 0, 1))[..., None]
    half = (np.pi / 2 - low) / 2
    t = low + half * (1 + nodes)
    x = np.asarray(x)[..., None]
    inner = np.cos(t) ** 2 * np.cos(8 * np.pi * waves * x * (np.sin(t) - x))
    return 4 / np.pi * np.sum(weights * inner * half, -1)


def covered(distance, cell):
    """Share of a cell inside an outline at `distance` from the middle of the cell, positive inside."""
    return np.clip(0.5 + distance / cell, 0, 1)


def edge(u, v, cell):
    """Layers of a slanted edge: reflectance (of all wavelengths, or of each), and the share covered."""
    a = np.deg2rad(5.0)
    yield 0.2, 1.0
    yield 0.8, covered(np.cos(a) * u + np.sin(a) * v, cell)


def dots(u, v, cell, pitch=0.05, diameter=0.025):
    """Layers of a grid of dots, one in the centre."""
    x, y = (p - pitch * np.round(p / pitch) for p in (u, v))
    yield 0.8, 1.0
    yield 0.04, covered(diameter / 2 - np.hypot(x, y), cell)


def colorchecker(u, v, cell, width=0.8):
    """Layers of a ColorChecker: ground, card, 24 patches of 0.86 of their pitch, a quarter of it around them."""
    pitch = width / 6.5

    def square(x, y, half_width, half_height):
        return covered(half_width - np.abs(u - x), cell) * covered(half_height - np.abs(v - y), cell)

    nm, *patches = table("scene/src/data/colorchecker.csv")
    yield 0.18, 1.0
    yield 0.035, square(0, 0, 3.25 * pitch, 2.25 * pitch)
    for i, patch in enumerate(patches):
        x, y = (i % 6 - 2.5) * pitch, (i // 6 - 1.5) * pitch
        yield np.interp(WAVELENGTHS, nm, patch), square(x, y, 0.43 * pitch, 0.43 * pitch)


CHARTS = {"slanted-edge": edge, "dots": dots, "colorchecker": colorchecker}


def electrons_per_lux_s(c, lens):
    """Photo-electrons of a white pixel per lux and second in each 10 nm, by filter of the pattern."""
    nm, _, v, _ = table("light/src/data/cie1931.csv")
    visible = 683 * np.sum(np.interp(nm, WAVELENGTHS, LAMP, 0, 0) * v)
    irradiance = 10 * LAMP / visible / (1 + 4 * lens.f_number**2)
    irradiance *= lens.factor + lens.slope * (WAVELENGTHS - 550) / 100
    photons = WAVELENGTHS * 1e-9 / (PLANCK * LIGHT_SPEED)
    area = (c.pitch_um * 1e-6) ** 2 * c.fill_factor
    return {f: area * photons * irradiance * c.qe(f) for f in dict.fromkeys(c.planes)}


def image(c, lens, scene):
    """Mean photo-electrons per lux and second of every pixel of a frame, height x width."""
    white = electrons_per_lux_s(c, lens)
    rows, columns = ((n + 2 * MARGIN) * FINE for n in (c.height, c.width))
    corner = np.hypot(c.width, c.height) / 2   # pixels, as all lengths from here
    y, x = ((np.arange(n) + 0.5) / FINE - n / FINE / 2 for n in (rows, columns))
    off_axis = x[None, :] - lens.x_px, y[:, None] - lens.y_px
    height = np.maximum(np.hypot(*off_axis), 1e-6)
    straight = height / lens.size
    for _ in range(20):   # Newton
        r2 = (straight / corner) ** 2
        straight -= (straight * (lens.size + lens.k1 * r2) - height) / (lens.size + 3 * lens.k1 * r2)
    scale = (straight / height).astype(np.float32)

    fx, fy = np.fft.rfftfreq(columns, 1 / FINE)[None, :], np.fft.fftfreq(rows, 1 / FINE)[:, None]
    frequency, aperture = np.hypot(fx, fy), np.sqrt(c.fill_factor)
    # Cells hold averages over their square, whose transfer function is divided out again.
    square = np.sinc(fx * aperture) * np.sinc(fy * aperture) / (np.sinc(fx / FINE) * np.sinc(fy / FINE))
    radii = np.linspace(0, 1, 400)

    def blur(nm):
        cutoff = c.pitch_um * 1e3 / (nm * lens.f_number)   # cycles per pixel
        waves = abs(lens.shift_um) * 1e3 / (8 * lens.f_number**2 * nm)
        return np.interp(frequency / cutoff, radii, pupil_transfer(radii, waves), right=0.0)

    apart = lens.blue_px != 0 or lens.red_px != 0
    bands = np.arange(len(WAVELENGTHS))
    spectra = dict.fromkeys(white, 0.0)
    for group in np.split(bands, len(bands) if apart else 1):
        off = np.interp(WAVELENGTHS[group[0]], [450, 550, 650], [lens.blue_px, 0, lens.red_px]) if apart else 0.0
        own = scale / np.float32(c.width * (1 + off / corner))
        pictures = {f: np.zeros((rows, columns), np.float32) for f in white}
        u, v = (np.float32(axis / c.width) + own * place for axis, place in zip((lens.x_px, lens.y_px), off_axis))
        for reflectance, cover in CHARTS[scene](u, v, 1 / (c.width * FINE)):
            for f, picture in pictures.items():
                picture += cover * (np.float32(np.sum((white[f] * reflectance)[group])) - picture)
        transfers = dict.fromkeys(white, 0.0)
        for b in group:
            of_band = blur(WAVELENGTHS[b])
            for f in white:
                transfers[f] = transfers[f] + white[f][b] * of_band
        for f, picture in pictures.items():
            transfer = transfers[f] / max(np.sum(white[f][group]), 1e-300)
            spectra[f] = spectra[f] + np.fft.rfft2(picture) * transfer * square

    inside = slice(MARGIN * FINE + FINE // 2, -MARGIN * FINE, FINE)
    out = np.empty((c.height, c.width), np.float32)
    side = 1 if len(c.planes) == 1 else 2   # of the filter pattern
    for i, f in enumerate(c.planes):
        plane = np.fft.irfft2(spectra[f], (rows, columns))[inside, inside]
        of_filter = np.s_[i // side :: side, i % side :: side]
        out[of_filter] = ((1 - lens.glare) * plane + lens.glare * plane.mean())[of_filter]
    return np.maximum(out, 0)


def exposure_for(c, lens, electrons, reflectance, lux):
    """Time, s, in which pixels of the strongest filter collect `electrons` behind this lens."""
    most = max(np.sum(e) for e in electrons_per_lux_s(c, lens).values())
    return digits(electrons / (most * reflectance * lux), 3)
