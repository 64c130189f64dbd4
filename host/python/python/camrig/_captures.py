"""Captures of a camera, and what they say about a model of it."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from . import _camrig, _plain
from ._camera import Camera

Progress = Callable[[str, int, int], object]


class Captures:
    """Stacks of frames with the conditions under which they were taken.

    Parameters
    ----------
    stacks : mapping
        By id, each a mapping with ``frames`` (uint16, frames x rows x columns, DN), ``role``
        (``dark``, ``flat``, ``edge``, ``chart``, ``dots``, ``scene``), ``exposure_s`` and what else
        ``[[capture]]`` of ``captures.toml`` takes: ``analog_gain``, ``temperature_c``, ``light``
        (a mapping: ``photons_per_pixel_per_s``, ``irradiance_w_m2`` with ``wavelength_nm``, ``lux``
        with ``illuminant``), ``scene``. The arrays are shared, not copied: leave
        their samples as they are.
    bits : int
        Bits of a sample.
    cfa : str, optional
        Colour filter pattern; monochrome if not given.
    black_level_dn : float, optional
        Measured from the darks if not given.
    white_level_dn : int, optional
        Value at which a sample saturates; the largest of ``bits`` if not given.
    pitch_um : float, optional

    Examples
    --------
    >>> import numpy as np
    >>> frames = np.full((24, 48, 64), 64, dtype=np.uint16)
    >>> Captures({"dark": dict(frames=frames, role="dark", exposure_s=0.01)}, bits=10)
    Captures(1 stacks, 64 x 48, 10 bits)
    """

    __slots__ = ("_own",)

    def __init__(
        self,
        stacks: Mapping[str, Mapping[str, Any]],
        *,
        bits: int,
        cfa: str | None = None,
        black_level_dn: float | None = None,
        white_level_dn: int | None = None,
        pitch_um: float | None = None,
    ) -> None:
        sensor = {
            "bits": bits,
            "cfa": cfa,
            "black_level_dn": black_level_dn,
            "white_level_dn": white_level_dn,
            "pitch_um": pitch_um,
        }
        frames = {}
        captures = ""
        for name, stack in dict(stacks).items():
            if {"id", "files"} & stack.keys():
                raise ValueError(f"captures {name!r}: the key is the id, and there are no files")
            if "frames" not in stack:
                raise ValueError(f"captures {name!r} have no frames")
            frames[name] = stack["frames"]
            conditions = {key: value for key, value in stack.items() if key != "frames"}
            table = _plain.lines({"id": name, "files": [], **conditions})
            captures += "\n".join(["[[capture]]", *table, ""])
        self._own = _camrig.Captures._of("\n".join(_plain.lines(sensor)), captures, frames)

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> Captures:
        """The capture set of a folder with ``captures.toml``; frames are read when needed."""
        captures = object.__new__(cls)
        captures._own = _camrig.Captures.load(folder)
        return captures

    @property
    def ids(self) -> list[str]:
        """Ids of the stacks."""
        return self._own.ids

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the frames."""
        return self._own.shape

    @property
    def bits(self) -> int:
        """Bits of a sample."""
        return self._own.bits

    def __repr__(self) -> str:
        return repr(self._own)


class Diagnosis:
    """What a diagnosis found.

    Attributes
    ----------
    report : dict
        As ``camrig diagnose --json`` prints it.
    toml : str
        The camera file with what was found.
    """

    def __init__(self, report: dict[str, Any], toml: str) -> None:
        self.report = report
        self.toml = toml

    @property
    def steps(self) -> list[dict[str, Any]]:
        """Effects that were tried: name, status, amounts, gap before and after."""
        return list(self.report["steps"])

    @property
    def explained(self) -> bool:
        """Whether the improved model agrees with the captures."""
        return bool(self.report["verdict"] == "explained")

    def __repr__(self) -> str:
        return f"Diagnosis({self.report['verdict']}, {len(self.steps)} steps)"


def diagnose(
    camera: Camera,
    captures: Captures,
    *,
    region: tuple[int, int, int, int] | None = None,
    without: str | Sequence[str] = (),
    progress: Progress | None = None,
) -> Diagnosis:
    """Search for the effects that a camera model lacks.

    Parameters
    ----------
    camera : Camera
    captures : Captures
    region : tuple of int, optional
        First column, first row, width and height of the part of the frames that is used.
    without : str or sequence of str
        Effects that are not looked for.
    progress : callable, optional
        Called with what, done and total (0 where nothing is counted).
    """
    found = _camrig.diagnose(
        _plain.instance("camera", camera, Camera)._own,
        _plain.instance("captures", captures, Captures)._own,
        region=region,
        without=[without] if isinstance(without, str) else list(without),
        progress=progress,
    )
    return Diagnosis(json.loads(found.report), found.improved)


def compare(
    camera: Camera,
    captures: Captures,
    *,
    region: tuple[int, int, int, int] | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Compare a camera model with captures, as ``camrig compare --json`` prints it."""
    text = _camrig.compare(
        _plain.instance("camera", camera, Camera)._own,
        _plain.instance("captures", captures, Captures)._own,
        region=region,
        progress=progress,
    )
    result: dict[str, Any] = json.loads(text)
    return result


class Fitted:
    """A camera file that follows from captures.

    Attributes
    ----------
    toml : str
        The file. What could not be known is ``"?"`` in it.
    values : dict
        By the path of its key ``value``, ``std_error``, ``unit``, ``grade`` and ``basis``.
    notes : list of str
    """

    def __init__(self, toml: str, values: dict[str, Any], notes: list[str]) -> None:
        self.toml = toml
        self.values = values
        self.notes = notes


def fit(
    captures: Captures,
    *,
    name: str = "",
    like: str | None = None,
    given: Mapping[str, Any] | None = None,
    dn_per_e: float | None = None,
) -> Fitted:
    """A camera file of dark and flat captures, as ``camrig camera fit`` makes it.

    Parameters
    ----------
    captures : Captures
    name : str
        Of the camera.
    like : str, optional
        Built-in sensor whose values stand where the captures tell nothing.
    given : mapping, optional
        Values of keys that stand whatever the captures tell.
    dn_per_e : float, optional
        System gain at unity gain, where there are no flats.
    """
    own = _plain.instance("captures", captures, Captures)._own
    dn_per_e = _plain.positive("dn_per_e", dn_per_e)
    text = _camrig.fit(own, name, like, _plain.lines(given or {}), dn_per_e)
    return Fitted(**json.loads(text))
