"""Figures of sensors and lenses, by the methods of the standards.

Each function returns what ``camrig measure ... --json`` prints: figures are dicts of ``value``,
``std_error`` (None where it is not known) and ``unit``.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _camrig, _plain
from ._captures import Captures

__all__ = ["dark", "emva", "mtf", "ptc"]


def _own(captures: Captures) -> _camrig.Captures:
    return _plain.instance("captures", captures, Captures)._own


def ptc(captures: Captures) -> dict[str, Any]:
    """Photon transfer: gain, read noise, dark current, full well, of dark and flat captures."""
    result: dict[str, Any] = json.loads(_camrig.ptc(_own(captures)))
    return result


def emva(captures: Captures) -> dict[str, Any]:
    """EMVA 1288 release 4.0, of dark and flat captures with known light."""
    result: dict[str, Any] = json.loads(_camrig.emva(_own(captures)))
    return result


def dark(
    frames: Captures | NDArray[np.uint16],
    *,
    bits: int = 16,
    cfa: str | None = None,
    dn_per_e: float | None = None,
) -> dict[str, Any]:
    """Offset, read noise, noise of rows and columns, hot pixels of frames without light.

    Parameters
    ----------
    frames : Captures or ndarray
        Captures with role ``dark``, or one stack: uint16, frames x rows x columns, DN.
    bits, cfa
        Of an array: bits of a sample, colour filter pattern (monochrome if not given).
    dn_per_e : float, optional
        System gain, for figures in electrons.
    """
    if not isinstance(frames, Captures):
        stack = {"frames": frames, "role": "dark", "exposure_s": 0.0}
        frames = Captures({"dark": stack}, bits=bits, cfa=cfa)
    result: dict[str, Any] = json.loads(_camrig.dark(
        frames._own, _plain.positive("dn_per_e", dn_per_e)
    ))
    return result


def mtf(
    frames: NDArray[np.uint16],
    *,
    cfa: str = "mono",
    channels: Sequence[str] | None = None,
    regions: Sequence[tuple[int, int, int, int]] = (),
    white_level_dn: int | None = None,
    pitch_um: float | None = None,
) -> dict[str, Any]:
    """The response over slanted edges (ISO 12233), ``edges`` of one or several frames.

    Parameters
    ----------
    frames : ndarray
        uint16, rows x columns or frames x rows x columns, DN.
    cfa : str
        Colour filter pattern, or ``mono``.
    channels : sequence of str, optional
        Letters of channels; all if not given.
    regions : sequence of tuple of int
        First column, first row, width and height of edges; searched for if none is given.
    white_level_dn : int, optional
        Value at which a sample saturates: clipped edges are refused.
    pitch_um : float, optional
        For cycles per millimetre.
    """
    letters = None if channels is None else list(channels)
    unknown = set(letters or ()) - set("M" if cfa.lower() == "mono" else cfa)
    if unknown:
        raise ValueError(f"channels: no {sorted(unknown)[0]!r} in {cfa}")
    pitch_um = _plain.positive("pitch_um", pitch_um)
    text = _camrig.mtf(frames, cfa, letters, [list(r) for r in regions], white_level_dn, pitch_um)
    result: dict[str, Any] = json.loads(text)
    return result
