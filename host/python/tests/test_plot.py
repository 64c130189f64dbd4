"""Drawings show the figures that they are given."""

import numpy as np
import pytest

import camrig

matplotlib = pytest.importorskip("matplotlib")
matplotlib.use("Agg")


def data(line):
    return np.array(line.get_data(), dtype=float)


def test_photon_transfer(folder):
    figures = camrig.measure.ptc(camrig.Captures.load(folder))
    ax = camrig.plot.photon_transfer(figures)
    names = list(figures["channels"])
    assert [text.get_text() for text in ax.get_legend().get_texts()] == names
    for name, bars in zip(names, ax.containers):
        points = [point for point in figures["channels"][name]["curve"] if point["used"]]
        drawn = data(bars.lines[0])
        assert drawn[0].tolist() == [point["signal_dn"] for point in points]
        assert drawn[1].tolist() == [point["variance_dn2"]["value"] for point in points]
        # The line passes through the points, within what dark current and the fit's errors leave.
        line = next(
            line
            for line in ax.lines
            if line.get_linestyle() == "-" and line.get_color() == bars.lines[0].get_color()
        )
        errors = np.array([point["variance_dn2"]["std_error"] for point in points])
        assert np.all(abs(np.interp(drawn[0], *data(line)) - drawn[1]) < 5 * errors)


def test_mtf(camera):
    edge = camera.set({"sensor.cfa": "mono"}, width=120, height=120)
    frame = edge.simulate("slanted-edge:angle=5", "auto", lux=1000)
    figures = camrig.measure.mtf(frame, regions=[(30, 30, 60, 60)])
    curve, half = camrig.plot.mtf(figures).lines
    (edge,) = figures["edges"]
    assert data(curve).T.tolist() == edge["curve"]
    assert data(half).ravel().tolist() == [edge["mtf50_cycles_per_pixel"]["value"], 0.5]


def test_spectra(camera):
    light = camera.irradiance("uniform:0.5", lux=300)
    ax = matplotlib.pyplot.subplots()[1]
    assert camrig.plot.spectra(light, ax=ax) is ax
    drawn = data(ax.lines[0])
    assert drawn[0].tolist() == light.wavelengths_nm.tolist()
    assert np.allclose(drawn[1], light.array().mean(axis=(1, 2)), rtol=1e-6)
    curves = camrig.plot.spectra({"half": np.full(3, 0.5)}, [400, 500, 600])
    assert data(curves.lines[0]).tolist() == [[400, 500, 600], [0.5, 0.5, 0.5]]
    with pytest.raises(ValueError, match="wavelengths_nm"):
        camrig.plot.spectra({"half": np.full(3, 0.5)})


def test_a_comparison_and_a_diagnosis(camera, folder):
    captures = camrig.Captures.load(folder)
    model = camera.set({"effect.row-temporal-noise.sigma_e": 0.0})
    comparison = camrig.compare(model, captures)
    ax = camrig.plot.deviations(comparison, most=3)
    known = [s["z_held_out"] for s in comparison["statistics"] if s["z_held_out"] is not None]
    assert [bar.get_width() for bar in ax.patches] == sorted(known, key=abs)[-3:]
    found = camrig.diagnose(model, captures)
    gaps = camrig.plot.gap(found).lines[0].get_ydata()
    assert list(gaps) == [found.report["gap_before"], *(s["gap_after"] for s in found.steps)]
