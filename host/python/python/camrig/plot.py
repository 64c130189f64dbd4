"""Drawings of figures, on axes of matplotlib (``pip install camrig[plot]``).

Each function draws what another one of the package returns, on ``ax`` or on axes of its own, and
returns the axes, to which labels, limits and further curves can be added.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ._camrig import Irradiance
from ._captures import Diagnosis

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["deviations", "gap", "mtf", "photon_transfer", "spectra"]

_COLOURS = {"r": "tab:red", "g": "tab:green", "b": "tab:blue", "m": "black"}


def _axes(ax: Axes | None) -> Axes:
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(layout="constrained")[1]


def photon_transfer(figures: Mapping[str, Any], *, ax: Axes | None = None) -> Axes:
    """Temporal variance against signal, DN² over DN: points of the captures, and the fitted lines.

    A line is K² r² + 1/12 + K s, with the channel's system gain K in DN/e⁻, its read noise r in e⁻
    and the signal s above dark in DN; the noise of dark current, which depends on the exposure, is
    left out. Points that the fit did not use are hollow. Error bars are standard errors.

    Parameters
    ----------
    figures : mapping
        What :func:`camrig.measure.ptc` returns.
    ax : matplotlib.axes.Axes, optional
    """
    ax = _axes(ax)
    for name, channel in figures["channels"].items():
        curve = channel["curve"]
        signal = np.array([point["signal_dn"] for point in curve])
        variance = np.array([point["variance_dn2"]["value"] for point in curve])
        error = np.array([point["variance_dn2"]["std_error"] for point in curve])
        used = np.array([point["used"] for point in curve], dtype=bool)
        bars = ax.errorbar(signal[used], variance[used], error[used], fmt="o", ms=4, label=name,
                           color=_COLOURS.get(name))
        colour = bars.lines[0].get_color()
        ax.plot(signal[~used], variance[~used], "o", ms=4, mfc="none", color=colour)
        gain, read = channel["system_gain_dn_per_e"], channel["read_noise_e"]
        if gain and read and used.any():
            at = np.geomspace(signal[used].min(), signal[used].max(), 100)
            floor = (gain["value"] * read["value"]) ** 2 + 1 / 12
            ax.plot(at, floor + gain["value"] * at, lw=1, color=colour)
    ax.set(xscale="log", yscale="log", xlabel="signal above dark, DN",
           ylabel="temporal variance, DN²")
    ax.legend()
    return ax


def mtf(figures: Mapping[str, Any], *, ax: Axes | None = None) -> Axes:
    """The modulation transfer of each edge against frequency, cycles per pixel, with its MTF50.

    Parameters
    ----------
    figures : mapping
        What :func:`camrig.measure.mtf` returns.
    ax : matplotlib.axes.Axes, optional
    """
    ax = _axes(ax)
    for edge in figures["edges"]:
        frequency, response = np.array(edge["curve"]).T
        label = f"{edge['channel']}, {edge['direction']}"
        (line,) = ax.plot(frequency, response, color=_COLOURS.get(edge["channel"]), label=label)
        half = edge["mtf50_cycles_per_pixel"]
        if half:
            ax.plot(half["value"], 0.5, "o", ms=5, color=line.get_color())
    ax.set(xlabel="cycles per pixel", ylabel="MTF", xlim=(0, 1), ylim=(0, None))
    ax.legend()
    return ax


def spectra(
    of: Irradiance | Mapping[str, NDArray[np.floating[Any]]],
    wavelengths_nm: NDArray[np.floating[Any]] | Sequence[float] | None = None,
    *,
    ax: Axes | None = None,
) -> Axes:
    """Spectra against wavelength, nm.

    Parameters
    ----------
    of : Irradiance or mapping
        Irradiance, of which the mean over the sensor is drawn in W m⁻² nm⁻¹; or curves by name.
    wavelengths_nm : array, optional
        Of curves: their wavelengths, in increasing order.
    ax : matplotlib.axes.Axes, optional
    """
    ax = _axes(ax)
    ax.set_xlabel("wavelength, nm")
    if isinstance(of, Irradiance):
        ax.plot(of.wavelengths_nm, of.array().mean(axis=(1, 2), dtype=np.float64), label="mean")
        ax.set_ylabel("irradiance, W m⁻² nm⁻¹")
    else:
        if wavelengths_nm is None:
            raise ValueError("curves need wavelengths_nm, the wavelengths of their samples")
        for name, values in of.items():
            ax.plot(wavelengths_nm, values, label=name)
        ax.legend()
    ax.set_ylim(bottom=0)
    return ax


def deviations(comparison: Mapping[str, Any], *, most: int = 12, ax: Axes | None = None) -> Axes:
    """The statistics of held-out frames that deviate most from a model, in standard deviations.

    Parameters
    ----------
    comparison : mapping
        What :func:`camrig.compare` returns.
    most : int
        Number of statistics, the largest deviation on top.
    ax : matplotlib.axes.Axes, optional
    """
    ax = _axes(ax)
    known = [s for s in comparison["statistics"] if s["z_held_out"] is not None]
    worst = sorted(known, key=lambda s: -abs(s["z_held_out"]))[:most][::-1]
    ax.barh(range(len(worst)), [s["z_held_out"] for s in worst])
    ax.set_yticks(range(len(worst)), [f"{s['statistic']}, {s['where']}" for s in worst])
    ax.axvline(0, color="black", lw=0.8)
    ax.set(xlabel="measured minus predicted, σ", title=f"gap {comparison['gap']:.3g}")
    return ax


def gap(diagnosis: Diagnosis, *, ax: Axes | None = None) -> Axes:
    """The gap of the model as given, and with each effect that a diagnosis found; 1 is perfect.

    Parameters
    ----------
    diagnosis : Diagnosis
        What :func:`camrig.diagnose` returns.
    ax : matplotlib.axes.Axes, optional
    """
    ax = _axes(ax)
    report = diagnosis.report
    names = ["as given", *(f"+ {step['effect']}" for step in diagnosis.steps)]
    values = [report["gap_before"], *(step["gap_after"] for step in diagnosis.steps)]
    ax.plot(range(len(names)), values, "o-")
    ax.axhline(report["gap_limit"], color="grey", ls="--", lw=1, label="limit of agreement")
    ax.set_xticks(range(len(names)), names)
    ax.set(yscale="log", ylabel="gap on held-out frames")
    ax.legend()
    return ax
