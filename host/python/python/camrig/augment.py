"""Noise of a sensor for training data: batches of clean pictures in, raw frames out.

Every frame is a pure function of its picture, its seed and the camera: the same in any batch, order
or worker process.

Examples
--------
>>> import camrig, numpy as np
>>> camera = camrig.Camera("mt9v024")
>>> clean = np.full((2, 8, 8, 3), 0.5, dtype=np.float32)
>>> raw = camrig.augment.noisy(clean, camera, white_e=8000, seeds=[1, 2])
>>> raw.shape, raw.dtype.name
((2, 8, 8), 'uint16')
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _camrig, _plain
from ._camera import Camera

__all__ = ["expose", "mosaic", "noisy", "unprocess"]


def expose(
    electrons: NDArray[np.floating[Any]],
    camera: Camera,
    *,
    seeds: Sequence[int],
    exposure_s: float = 0.01,
    gain: float | None = None,
    arithmetic: str = "f32",
) -> NDArray[np.uint16]:
    """Raw frames of known mean electrons: shot noise, dark current, patterns, read-out, converter.

    Parameters
    ----------
    electrons : ndarray
        Mean photo-electrons of each pixel in the exposure: frames x rows x columns.
    camera : Camera
        Its lens, quantum efficiency and size do not matter.
    seeds : sequence of int
        A frame number for each frame, 0 to 2^32 - 1, which fixes its noise. Fixed patterns are
        those of the camera's ``sensor.seed``.
    exposure_s : float
        For the dark current, s.
    gain : float, optional
        Analog gain; that of the camera file if not given.
    arithmetic : {"f32", "fixed"}

    Returns
    -------
    ndarray
        DN, uint16, frames x rows x columns.
    """
    means = np.ascontiguousarray(electrons, dtype=np.float32)
    if means.ndim != 3:
        raise ValueError(f"electrons of shape {means.shape}: give frames x rows x columns")
    _plain.instance("camera", camera, Camera)
    if camera.shape != means.shape[1:]:
        camera = camera.set(height=means.shape[1], width=means.shape[2])
    numbers = [_plain.whole("seeds", seed) for seed in seeds]
    _plain.positive("exposure_s", exposure_s)
    return _camrig.expose_electrons(camera._own, means, numbers, exposure_s, gain, arithmetic)


def mosaic(pictures: NDArray[np.floating[Any]], cfa: str) -> NDArray[np.float32]:
    """The samples that a pattern of 2 x 2 lets through: frames x rows x columns.

    Parameters
    ----------
    pictures : ndarray
        Red, green and blue: frames x rows x columns x 3.
    cfa : str
        Four letters of R, G, B, row by row, or ``mono`` for the mean of the three.
    """
    if pictures.ndim != 4 or pictures.shape[3] != 3:
        raise ValueError(f"pictures of shape {pictures.shape}: give frames x rows x columns x 3")
    if cfa.lower() == "mono":
        return np.asarray(pictures.mean(axis=3), dtype=np.float32)
    if len(cfa) != 4 or set(cfa) - set("RGB"):
        raise ValueError(f"cfa = {cfa!r}: four letters of R, G, B, or mono")
    out = np.empty(pictures.shape[:3], np.float32)
    for place, letter in enumerate(cfa):
        y, x = divmod(place, 2)
        out[:, y::2, x::2] = pictures[:, y::2, x::2, "RGB".index(letter)]
    return out


def unprocess(
    srgb: NDArray[np.floating[Any]],
    *,
    white_balance: tuple[float, float, float] = (2.0, 1.0, 1.6),
    colour_matrix: NDArray[np.floating[Any]] | None = None,
) -> NDArray[np.float32]:
    """Linear red, green and blue of a sensor from finished pictures.

    Undoes, in this order, the tone curve of sRGB (IEC 61966-2-1), the colour matrix and the white
    balance, as Brooks et al. 2019 ("Unprocessing Images for Learned Raw Denoising") do; their
    smoothstep and digital gain are left out. Highlights that a converter clipped stay clipped.

    Parameters
    ----------
    srgb : ndarray
        0 to 1, last axis red, green, blue.
    white_balance : tuple of float
        Gains of red, green and blue that the converter applied: white is 1/gain in the result.
    colour_matrix : ndarray, optional
        From the sensor's white-balanced red, green, blue to linear sRGB, 3 x 3, rows of sum 1; none
        if not given.
    """
    values = np.asarray(srgb, dtype=np.float32)
    if values.shape[-1] != 3 or not (values.min() >= 0 and values.max() <= 1):
        raise ValueError("srgb: values from 0 to 1, last axis red, green, blue")
    gains = np.asarray(white_balance, dtype=np.float64)
    if gains.shape != (3,) or not (np.isfinite(gains).all() and gains.min() > 0):
        raise ValueError("white_balance: three gains above 0")
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    if colour_matrix is not None:
        matrix = np.asarray(colour_matrix, dtype=np.float64)
        if matrix.shape != (3, 3) or not np.allclose(matrix.sum(axis=1), 1, atol=1e-3):
            raise ValueError("colour_matrix: 3 x 3, rows of sum 1, which keep white")
        linear = linear @ np.linalg.inv(matrix).T
    raw = np.clip(linear, 0, None) / gains
    return np.asarray(raw, dtype=np.float32)


def noisy(
    pictures: NDArray[np.floating[Any]],
    camera: Camera,
    *,
    white_e: float,
    seeds: Sequence[int],
    exposure_s: float = 0.01,
    gain: float | None = None,
    arithmetic: str = "f32",
) -> NDArray[np.uint16]:
    """Raw frames of linear pictures: :func:`mosaic` in the camera's pattern, then :func:`expose`.

    Parameters
    ----------
    pictures : ndarray
        Linear red, green and blue of the sensor (see :func:`unprocess`): frames x rows x columns
        x 3.
    white_e : float
        Mean electrons of 1.
    """
    return expose(
        mosaic(np.asarray(pictures), camera.cfa) * np.float32(white_e),
        camera,
        seeds=seeds,
        exposure_s=exposure_s,
        gain=gain,
        arithmetic=arithmetic,
    )
