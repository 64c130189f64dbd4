"""The compiled half of camrig."""

from collections.abc import Callable, Iterator
from os import PathLike
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Camera",
    "CamrigError",
    "Captures",
    "Irradiance",
    "_Batch",
    "_Diagnosis",
    "__version__",
    "compare",
    "dark",
    "diagnose",
    "effects",
    "emva",
    "expose_electrons",
    "fit",
    "irradiance",
    "main",
    "mtf",
    "presets",
    "ptc",
    "read_raw",
    "write_raw",
]
__version__: str

_Progress = Callable[[str, int, int], object] | None
_Path = str | PathLike[str]

class CamrigError(Exception):
    """What is wrong, where, and what would be right."""

    kind: str
    """``input``, ``io``, ``unsupported``, ``limit``, ``disagreement`` or ``internal``."""
    what: str
    where: str | None
    help: str | None
    code: str | None
    """Name of the error where programs may want to tell it from others."""

@final
class Camera:
    def __new__(cls, camera: str) -> Camera: ...
    @staticmethod
    def from_toml(text: str, folder: _Path) -> Camera: ...
    def _changed(self, changes: list[str]) -> Camera: ...
    def to_toml(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def shape(self) -> tuple[int, int]: ...
    @property
    def bits(self) -> int: ...
    @property
    def cfa(self) -> str: ...
    @property
    def black_level_dn(self) -> float: ...

@final
class Irradiance:
    """Spectral irradiance on a sensor, W m⁻² nm⁻¹."""

    @staticmethod
    def load(path: _Path) -> Irradiance:
        """A file of ``camrig simulate --save-irradiance``; samples are read when needed."""
    def save(self, path: _Path, *, overwrite: bool = False) -> None:
        """Writes it as such a file."""
    @property
    def shape(self) -> tuple[int, int, int]:
        """Bands, rows and columns."""
    @property
    def wavelengths_nm(self) -> NDArray[np.float64]:
        """Centres of the bands."""
    @property
    def lux(self) -> float | None:
        """Illuminance of the scene that it was made for."""
    @property
    def made_of(self) -> str:
        """Scene and lens in words."""
    @property
    def notes(self) -> list[str]:
        """What to know about the scene and the lens."""
    def array(self) -> NDArray[np.float32]:
        """The samples, decoded from 16-bit block floating point: bands x rows x columns."""
    def _frames(
        self,
        camera: Camera,
        exposure: float | str,
        *,
        gain: float | None = None,
        frames: int | None = None,
        first_frame: int = 0,
        arithmetic: str = "f32",
        rig: str | None = None,
    ) -> Iterator[Any]: ...

@final
class Captures:
    @staticmethod
    def load(folder: _Path) -> Captures: ...
    @staticmethod
    def _of(sensor: str, captures: str, arrays: dict[str, Any]) -> Captures: ...
    @property
    def ids(self) -> list[str]: ...
    @property
    def shape(self) -> tuple[int, int]: ...
    @property
    def bits(self) -> int: ...

@final
class _Batch:
    def __new__(cls, sweep: _Path, directory: _Path) -> _Batch: ...
    def __len__(self) -> int: ...
    def make(self, index: int) -> None: ...

@final
class _Diagnosis:
    @property
    def report(self) -> str: ...
    @property
    def improved(self) -> str: ...

def irradiance(
    camera: Camera,
    scene: str,
    *,
    illuminant: str | None = None,
    lux: float | None = None,
    luminance: float | None = None,
    scene_irradiance: float | None = None,
    oversample: int | None = None,
    cache: bool = True,
    progress: _Progress = None,
) -> Irradiance: ...
def diagnose(
    camera: Camera,
    captures: Captures,
    *,
    region: tuple[int, int, int, int] | None = None,
    without: list[str],
    progress: _Progress = None,
) -> _Diagnosis: ...
def compare(
    camera: Camera,
    captures: Captures,
    *,
    region: tuple[int, int, int, int] | None = None,
    progress: _Progress = None,
) -> str: ...
def expose_electrons(
    camera: Camera,
    electrons: NDArray[np.float32],
    seeds: list[int],
    exposure_s: float,
    gain: float | None,
    arithmetic: str,
) -> NDArray[np.uint16]: ...
def ptc(captures: Captures) -> str: ...
def emva(captures: Captures) -> str: ...
def dark(captures: Captures, dn_per_e: float | None) -> str: ...
def mtf(
    frames: Any,
    cfa: str,
    channels: list[str] | None,
    regions: list[list[int]],
    white_level_dn: int | None,
    pitch_um: float | None,
) -> str: ...
def fit(
    captures: Captures,
    name: str,
    like: str | None,
    given: list[str],
    dn_per_e: float | None,
) -> str: ...
def read_raw(path: _Path) -> tuple[NDArray[np.uint16], dict[str, Any]]:
    """Frames of a raw file in any format that camrig reads, and what the file says about them.

    Returns
    -------
    samples : ndarray
        uint16, DN: rows x columns, or frames x rows x columns of several frames.
    facts : dict
        ``bits``, ``cfa``, ``black_level_dn``, ``white_level_dn`` (None where the file does not
        say) and ``notes``.
    """

def write_raw(
    path: _Path,
    frames: NDArray[np.uint16],
    *,
    bits: int,
    cfa: str | None = None,
    black_level_dn: float | None = None,
    white_level_dn: int | None = None,
    overwrite: bool = False,
) -> None:
    """Writes frames in the format of the file's name (.tiff, .npy, .fits, .pgm, .png, .dng)."""

def presets() -> list[str]:
    """Names of the built-in cameras."""

def effects() -> dict[str, str]:
    """Effects of sensor and optics by name, each with its equation, source and range in words."""

def main(arguments: list[str]) -> int:
    """Runs the program on arguments, of which the first is its name; its exit status."""
