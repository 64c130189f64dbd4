"""Cameras."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Union

import numpy as np
from numpy.typing import NDArray

from . import _camrig, _plain
from ._camrig import Irradiance

Exposure = Union[float, str]
Frame = Union[NDArray[np.uint16], NDArray[np.uint32], "dict[str, NDArray[np.uint16]]"]

# Keys of [sensor] that need no path.
_SHORT = ("width", "height", "pitch_um", "bits", "cfa", "black_level_dn", "full_well_e")


class Camera:
    """Lens, sensor and effects of one camera; immutable.

    Parameters
    ----------
    camera : str or path
        A preset (:func:`presets` has their names) or a camera file.

    Examples
    --------
    >>> camera = Camera("mt9v024").set({"sensor.noise.prnu": 0.02}, width=64, height=48)
    >>> camera.shape
    (48, 64)
    """

    __slots__ = ("_made_of", "_own")

    def __init__(self, camera: str | os.PathLike[str]) -> None:
        name = os.fspath(camera)
        self._own = _camrig.Camera(name)
        # What makes it again in another process: a name or a text with its folder, and changes.
        self._made_of: tuple[tuple[str, ...], list[str]] = ((name,), [])

    @classmethod
    def _of(cls, source: tuple[str, ...], changes: list[str]) -> Camera:
        own = _camrig.Camera(*source) if len(source) == 1 else _camrig.Camera.from_toml(*source)
        camera = object.__new__(cls)
        camera._own = own._changed(changes) if changes else own
        camera._made_of = (source, changes)
        return camera

    def __reduce__(self) -> tuple[Any, ...]:
        return (Camera._of, self._made_of)

    @classmethod
    def from_toml(cls, text: str, folder: str | os.PathLike[str] = ".") -> Camera:
        """A camera of the text of a camera file; files that it names are in ``folder``."""
        return cls._of((text, os.fspath(folder)), [])

    def set(self, keys: Mapping[str, Any] | None = None, /, **short: Any) -> Camera:
        """The camera with other values of keys of its file.

        Parameters
        ----------
        keys : mapping, optional
            Values by the paths of their keys (``{"sensor.noise.read_e": 2.5}``,
            ``{"effect.row-temporal-noise.sigma_e": 1.0}``), as with ``--set`` of the program.
        **short
            Keys of ``[sensor]`` by their names alone: width, height, pitch_um, bits, cfa,
            black_level_dn, full_well_e.
        """
        unknown = [key for key in short if key not in _SHORT]
        if unknown:
            raise TypeError(f"{unknown[0]}: give it by its path, set({{'sensor.…': value}})")
        paths = {f"sensor.{key}": value for key, value in short.items()}
        source, changes = self._made_of
        return self._of(source, [*changes, *_plain.lines({**(keys or {}), **paths})])

    def to_toml(self) -> str:
        """The text of the camera file. Tables that it names are files beside the one it is of."""
        return self._own.to_toml()

    @property
    def name(self) -> str:
        """Its name."""
        return self._own.name

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self._own.shape

    @property
    def bits(self) -> int:
        """Bits of a sample."""
        return self._own.bits

    @property
    def cfa(self) -> str:
        """Colour filter pattern, such as ``RGGB``."""
        return self._own.cfa

    @property
    def black_level_dn(self) -> float:
        """Mean of a frame without light, DN."""
        return self._own.black_level_dn

    def __repr__(self) -> str:
        return repr(self._own)

    def irradiance(
        self,
        scene: str | os.PathLike[str] | NDArray[np.floating[Any]],
        *,
        wavelengths_nm: NDArray[np.floating[Any]] | None = None,
        quantity: str = "reflectance",
        **light: Any,
    ) -> Irradiance:
        """The irradiance of a scene on the sensor.

        Parameters
        ----------
        scene : str, path or array
            A chart (``colorchecker``, ``slanted-edge:angle=5``), a file, or an array of rows x
            columns x bands.
        wavelengths_nm : array, optional
            Centres of the bands of an array, nm, in any order.
        quantity : {"reflectance", "radiance"}
            Of an array: reflectance from 0 to 1, or radiance in W m⁻² sr⁻¹ nm⁻¹.
        illuminant : str, optional
            On a scene of reflectances: ``D65``, ``A``, ``blackbody:3200``, a CSV.
        lux, luminance, scene_irradiance : float, optional
            The light level: lx, cd/m² of a perfect white, or W/m² from 300 to 1100 nm.
        oversample : int, optional
            Cells per pixel and direction; chosen by error if not given.
        cache : bool, optional
            Whether results are kept on disk, as the program keeps them (True).
        progress : callable, optional
            Called with what, done and total.

        Returns
        -------
        Irradiance
        """
        if not isinstance(scene, np.ndarray):
            return _camrig.irradiance(self._own, os.fspath(scene), **light)
        with tempfile.TemporaryDirectory(prefix="camrig-") as folder:
            spec = _scene_file(Path(folder), scene, wavelengths_nm, quantity)
            return _camrig.irradiance(self._own, spec, **{**light, "cache": False})

    def expose(
        self,
        irradiance: Irradiance,
        exposure: Exposure,
        *,
        gain: float | None = None,
        frames: int | None = None,
        first_frame: int = 0,
        arithmetic: str = "f32",
        rig: str | None = None,
    ) -> Any:
        """Raw frames of an irradiance.

        Parameters
        ----------
        irradiance : Irradiance
            Of this camera's sensor.
        exposure : float or str
            Seconds; ``"auto"`` (99.9 % of each channel below 0.85 of full scale) or
            ``"auto:SHARE"`` (mean of green, as a fraction of full scale above black).
        gain : float, optional
            Analog gain; that of the camera file if not given.
        frames : int, optional
            Number of frames in time; one if not given.
        first_frame : int
            Number of the first frame, which is the seed of its noise.
        arithmetic : {"f32", "fixed"}
        rig : str, optional
            Address of a rig that exposes the frames in place of this machine.

        Returns
        -------
        ndarray
            DN, uint16: rows x columns, or frames x rows x columns where ``frames`` is given.
            Of a sensor with ``[sensor.hdr]`` uint32 where it sends 20 or 24 bits, and a dict of
            arrays by capture where it sends its captures.
        """
        sequence = irradiance._frames(
            self._own,
            exposure,
            gain=gain,
            frames=1 if frames is None else _plain.whole("frames", frames, least=1),
            first_frame=_plain.whole("first_frame", first_frame),
            arithmetic=arithmetic,
            rig=rig,
        )
        if frames is None:
            return next(sequence)
        return _stacked(sequence, frames)

    def sequence(
        self, irradiance: Irradiance, exposure: Exposure, *, frames: int | None = None, **rest: Any
    ) -> Iterator[Frame]:
        """Frames in time, one by one, without end unless ``frames`` is given; see :meth:`expose`."""
        return irradiance._frames(self._own, exposure, frames=frames, **rest)

    def simulate(
        self,
        scene: str | os.PathLike[str] | NDArray[np.floating[Any]],
        exposure: Exposure,
        *,
        gain: float | None = None,
        frames: int | None = None,
        first_frame: int = 0,
        arithmetic: str = "f32",
        rig: str | None = None,
        **light: Any,
    ) -> Any:
        """Raw frames of a scene: :meth:`irradiance`, then :meth:`expose`.

        Examples
        --------
        >>> Camera("mt9v024").set(width=64, height=48).simulate("uniform:0.18", 0.01).shape
        (48, 64)
        """
        return self.expose(
            self.irradiance(scene, **light),
            exposure,
            gain=gain,
            frames=frames,
            first_frame=first_frame,
            arithmetic=arithmetic,
            rig=rig,
        )


def _stacked(frames: Iterator[Frame], count: int) -> Any:
    """Frames as one array (of each capture), which each is copied into as it comes."""
    first = next(frames)
    if isinstance(first, dict):
        all_of = {name: np.empty((count, *f.shape), f.dtype) for name, f in first.items()}
        for n, frame in enumerate([first, *frames]):
            for name, samples in frame.items():  # type: ignore[union-attr]
                all_of[name][n] = samples
        return all_of
    out = np.empty((count, *first.shape), first.dtype)
    out[0] = first
    for n, frame in enumerate(frames, 1):
        out[n] = frame
    return out


def _scene_file(
    folder: Path, scene: NDArray[Any], wavelengths_nm: NDArray[Any] | None, quantity: str
) -> str:
    """An array as a cube with its sidecar, which the library checks as any other."""
    if wavelengths_nm is None:
        raise ValueError("a scene of an array needs wavelengths_nm, the centres of its bands")
    path = folder / "scene.npy"
    np.save(path, np.ascontiguousarray(scene, dtype=np.float32))
    nm = np.asarray(wavelengths_nm, dtype=float)
    sidecar = _plain.lines({"quantity": quantity, "axes": "yxb", "wavelength_nm": nm})
    path.with_suffix(".toml").write_text("\n".join(sidecar), encoding="utf-8")
    return str(path)
