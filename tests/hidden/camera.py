"""The base camera of a hidden data set and its captures: drawn at random, written as the files camrig reads.

Files: camera.toml, qe.csv, captures.toml. Everything the simulation uses is rounded first and written in full,
so the files say exactly what the frames were made with.
"""
import zlib
from dataclasses import dataclass

import numpy as np

PLANCK, LIGHT_SPEED = 6.62607015e-34, 299792458.0
BITS = 12
F_NUMBER = 2.8
WHITE = 2**BITS - 1
WAVELENGTHS = np.arange(400, 701, 10)
# Dye filters as Gaussians (centre and width, nm) over a silicon hump: shapes only need to be plausible.
FILTERS = {"r": (610, 45), "g": (535, 45), "b": (455, 40), "mono": (560, 160)}


def stream(seed, *names):
    """A separate random generator for each random quantity."""
    return np.random.default_rng([seed, zlib.crc32("/".join(map(str, names)).encode())])


def digits(x, n=4):
    """`x` rounded to `n` significant decimal digits."""
    return float(f"{x:.{n - 1}e}")


@dataclass(frozen=True)
class Camera:
    """The values in camera.toml. Electrons, seconds, degrees Celsius."""
    width: int
    height: int
    cfa: str            # "mono" or a 2x2 pattern, row-major
    pitch_um: float
    fill_factor: float
    qe_peak: float
    full_well_e: float  # fixes the gain
    black_dn: float
    read_e: float
    dark_e_per_s: float
    dsnu_e_per_s: float
    doubling_c: float
    prnu: float
    row_fpn_e: float
    gain_error: float = 0.0   # relative; a mis-set system gain, never written

    reference_c = 25.0

    @property
    def gain(self):
        """System gain K, DN/e-: full scale at full well (eq. 11 of the model's paper)."""
        return WHITE / self.full_well_e * (1 + self.gain_error)

    @property
    def saturation_e(self):
        """Signal at which the code reaches full scale, above the black level."""
        return (WHITE - self.black_dn) / self.gain

    @property
    def planes(self):
        """Filter of each plane, in the order (0,0) (0,1) (1,0) (1,1) of row and column parity."""
        return ["mono"] if self.cfa == "mono" else [c.lower() for c in self.cfa]

    def qe(self, filter_name):
        """Quantum efficiency at `WAVELENGTHS`, filter included."""
        centre, width = FILTERS[filter_name]
        return np.round(0.02 + (self.qe_peak - 0.02) * np.exp(-(((WAVELENGTHS - centre) / width) ** 2)), 4)

    def electrons_per_joule_m2(self, wavelength_nm):
        """Photo-electrons per J/m2 in each plane: pitch^2 fill QE lambda / (h c)."""
        photons = wavelength_nm * 1e-9 / (PLANCK * LIGHT_SPEED)
        at = list(WAVELENGTHS).index(wavelength_nm)
        area = (self.pitch_um * 1e-6) ** 2 * self.fill_factor
        return np.array([area * photons * self.qe(f)[at] for f in self.planes])

    def spread(self, per_plane):
        """Expands one value per plane to a map of the frame (a scalar for mono)."""
        if len(per_plane) == 1:
            return np.float32(per_plane[0])
        cell = np.asarray(per_plane, np.float32).reshape(2, 2)
        return np.tile(cell, (self.height // 2, self.width // 2))


def draw(rng, width, height, cfa):
    """A plausible base camera: around 0.5 DN/e-, 3 e- read noise, 5 e-/s dark current, 12 bits."""
    u = rng.uniform
    dark = digits(u(3.5, 7))
    return Camera(
        width=width, height=height, cfa=cfa, pitch_um=digits(u(1.8, 4), 3), fill_factor=digits(u(0.5, 0.95), 3),
        qe_peak=digits(u(0.45, 0.75), 3), full_well_e=digits(WHITE / u(0.45, 0.6)), black_dn=float(rng.integers(48, 97)),
        read_e=digits(u(2.4, 4), 3), dark_e_per_s=dark, dsnu_e_per_s=digits(dark * u(0.3, 0.4), 3),
        doubling_c=digits(u(6, 8), 3), prnu=digits(u(0.005, 0.01), 3), row_fpn_e=digits(u(0.2, 0.4), 3))


@dataclass(frozen=True)
class Stack:
    """Repeated frames under the same conditions. `electrons`: mean photo-electrons of a frame, per plane."""
    id: str
    role: str
    frames: int
    exposure_s: float
    temperature_c: float = Camera.reference_c
    irradiance: float = 0.0
    wavelength_nm: int = 0
    preceded_by: str = ""
    electrons: tuple = (0.0,)
    analog_gain: float = 1.0
    scene: str = ""           # what was looked at, under `lux`
    lux: float = 0.0


LEVELS = (1.25, 5, 12.5, 25, 44, 62, 78, 91)  # percent of saturation
FLAT_S = 0.005


def design(camera, name):
    """The captures of a set: `small` (176 frames of mono) or `full` (384)."""
    many = {"small": 1, "full": 2}[name]
    planes = len(camera.planes)

    def dark(id, frames, exposure, **more):
        return Stack(id, "dark", frames * many, exposure, electrons=(0.0,) * planes, **more)

    def flat(id, electrons, at_s, exposure, wavelength=550):
        per_joule = camera.electrons_per_joule_m2(wavelength)
        irradiance = digits(electrons / (per_joule.max() * at_s), 6)
        return Stack(id, "flat", 8 * many, exposure, irradiance=irradiance, wavelength_nm=wavelength,
                     electrons=tuple(per_joule * irradiance * exposure))

    full = camera.saturation_e
    stacks = [dark("dark-short", 32, 0.01), dark("dark-long", 16, 1.0), dark("dark-100ms", 8, 0.1),
              dark("dark-300ms", 8, 0.3)]
    stacks += [flat(f"flat-level-{i}", full * level / 100, FLAT_S, FLAT_S) for i, level in enumerate(LEVELS, 1)]
    stacks += [flat(f"flat-{s * 1e6:05.0f}us", full * 0.375, FLAT_S, s) for s in (0.0002, 0.001, 0.012)]
    if planes > 1:
        stacks += [flat(f"flat-{w}nm", full * 0.5, FLAT_S, FLAT_S, w) for w in (460, 610)]
    stacks += [dark("dark-after-bright", 8, 0.01, preceded_by=f"flat-level-{len(LEVELS)}"),
               dark("dark-cold", 8, 0.5, temperature_c=12.0), dark("dark-warm", 8, 0.5, temperature_c=40.0)]
    return stacks


def camera_files(c):
    """Names and texts of the camera file and of the files that it refers to."""
    names = list(dict.fromkeys(sorted(c.planes, key="rgbmono".index)))
    columns = np.column_stack([WAVELENGTHS] + [c.qe(n) for n in names])
    head = "wavelength_nm," + ",".join("qe" if n == "mono" else n for n in names)
    qe = "\n".join([head] + [",".join(f"{v:g}" for v in row) for row in columns]) + "\n"
    return {"qe.csv": qe, "camera.toml": f"""\
name = "hidden"

[lens]
kind = "diffraction-limited"
f_number = {F_NUMBER}
focal_length_mm = 4.0
transmittance = 1.0
relative_illumination = "none"

[sensor]
width = {c.width}
height = {c.height}
pitch_um = {c.pitch_um}
fill_factor = {c.fill_factor}
cfa = "{c.cfa}"
qe = "qe.csv"
conversion_gain_uv_per_e = 75.0
full_well_e = {c.full_well_e}
bits = {BITS}
black_level_dn = {c.black_dn}
analog_gain = 1.0
temperature_c = {c.reference_c}
seed = 1

[sensor.noise]
read_e = {c.read_e}
read_e_post = 0.0
dark_current_e_per_s = {c.dark_e_per_s}
dark_doubling_c = {c.doubling_c}
temperature_ref_c = {c.reference_c}
dsnu_e_per_s = {c.dsnu_e_per_s}
prnu = {c.prnu}
row_fpn_e = {c.row_fpn_e}
"""}


def captures_toml(c, stacks):
    """The manifest of the set."""
    text = f"""\
format = "captures/1"
camera = "camera.toml"

[source]
sensor = "simulated by an independent generator"

[sensor]
width = {c.width}
height = {c.height}
bits = {BITS}
cfa = "{c.cfa}"
black_level_dn = {c.black_dn}
white_level_dn = {WHITE}
pitch_um = {c.pitch_um}
"""
    for s in stacks:
        text += f"""
[[capture]]
id = "{s.id}"
role = "{s.role}"
files = "{s.id}.npy"
exposure_s = {s.exposure_s}
analog_gain = {s.analog_gain}
temperature_c = {s.temperature_c}
"""
        if s.preceded_by:
            text += f'preceded_by = "{s.preceded_by}"\n'
        if s.role == "flat":
            text += f"""
[capture.light]
irradiance_w_m2 = {s.irradiance!r}
wavelength_nm = {float(s.wavelength_nm)}
uniformity = "flat"
"""
        elif s.scene:
            text += f"""
[capture.light]
illuminant = "lamp.csv"
lux = {s.lux!r}

[capture.scene]
scene = "{s.scene}"
"""
    return text
