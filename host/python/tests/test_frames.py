"""Frames are those of the program, byte for byte."""

import copy
import pickle

import numpy as np
import pytest

import camrig

LIGHT = ("--scene", "colorchecker", "--lux", "300")


@pytest.mark.parametrize("arithmetic", ["f32", "fixed"])
def test_frames_equal_those_of_the_program(camera, program, tmp_path, arithmetic):
    program("simulate", "--camera", "small.toml", *LIGHT, "--exposure", "10ms", "--frames", 3,
            "--arith", arithmetic, "-o", "a.npy")  # fmt: skip
    frames = camera.simulate("colorchecker", 0.010, lux=300, frames=3, arithmetic=arithmetic)
    assert frames.dtype == np.uint16
    assert np.array_equal(frames, np.load(tmp_path / "a.npy"))
    one = camera.simulate("colorchecker", 0.010, lux=300, first_frame=1, arithmetic=arithmetic)
    assert np.array_equal(one, frames[1])


def test_automatic_exposure_is_that_of_the_program(camera, program, tmp_path):
    program("simulate", "--camera", "small.toml", *LIGHT, "--exposure", "auto:0.2", "-o", "a.npy")
    assert np.array_equal(
        camera.simulate("colorchecker", "auto:0.2", lux=300), np.load(tmp_path / "a.npy")
    )


def test_irradiance_is_that_of_the_program(camera, program, tmp_path):
    program("simulate", "--camera", "small.toml", *LIGHT, "--exposure", "10ms", "-o", "a.npy",
            "--save-irradiance", "a.irr")  # fmt: skip
    own = camera.irradiance("colorchecker", lux=300)
    saved = camrig.Irradiance.load(tmp_path / "a.irr")
    assert own.shape == saved.shape == (len(own.wavelengths_nm), 48, 64)
    assert own.array().dtype == np.float32
    assert np.array_equal(own.array(), saved.array())
    assert np.array_equal(camera.expose(saved, 0.010), np.load(tmp_path / "a.npy"))
    own.save(tmp_path / "b.irr")
    assert (tmp_path / "b.irr").read_bytes() == (tmp_path / "a.irr").read_bytes()


def test_irradiance_of_a_grey_card(camera):
    """E = πL sin²θ = πL/(4N² + 1) at the centre, L of half of a perfect white."""
    irradiance = camera.irradiance("uniform:0.5", illuminant="E", lux=1000)
    nm, centre = irradiance.wavelengths_nm, irradiance.array()[:, 24, 32]
    # 683 lm/W times the integral with V(λ), here its usual approximation by a Gaussian.
    v = 1.019 * np.exp(-285.4 * (nm / 1000 - 0.559) ** 2)
    illuminance = 683 * np.sum(centre * v) * (nm[1] - nm[0])
    assert illuminance == pytest.approx(1000 * 0.5 / (4 * 2.8**2 + 1), rel=0.01)


def test_a_sequence_is_an_iterator_without_end(camera):
    light = camera.irradiance("uniform:0.18", lux=300)
    frames = camera.sequence(light, 0.005)
    first, second = next(frames), next(frames)
    assert np.array_equal(np.stack([first, second]), camera.expose(light, 0.005, frames=2))
    assert not np.array_equal(first, second)


def test_an_hdr_sensor_gives_its_captures_or_32_bits(camera_file):
    hdr = camrig.Camera("imx585-clear-hdr").set(width=64, height=48)
    frame = hdr.simulate("colorchecker", 0.005, lux=300)
    assert isinstance(frame, dict) or frame.dtype in (np.uint16, np.uint32)


def test_arrays_are_scenes(camera):
    nm = np.arange(400, 701, 10.0)
    grey = np.full((48, 64, nm.size), 0.18)
    own = camera.simulate(grey, 0.010, wavelengths_nm=nm, lux=300)
    named = camera.simulate("uniform:0.18", 0.010, lux=300)
    # The chart knows its reflectance beyond 700 nm, the array is dark there.
    assert own.mean() == pytest.approx(named.mean(), rel=0.05)
    with pytest.raises(ValueError, match="wavelengths_nm"):
        camera.simulate(grey, 0.010)
    grey[3, 4, 5] = np.nan
    with pytest.raises(camrig.CamrigError):
        camera.simulate(grey, 0.010, wavelengths_nm=nm)
    with pytest.raises(camrig.CamrigError):
        camera.simulate(np.full((4, 4, nm.size), -1.0), 0.010, wavelengths_nm=nm)


def test_keys_of_a_camera(camera):
    quiet = camera.set({"sensor.noise.read_e": 0.5, "effect.row-temporal-noise.sigma_e": 0.0})
    assert "read_e = 0.5" in quiet.to_toml() and camera.shape == (48, 64)
    assert quiet.set(width=32).shape == (48, 32)
    assert (camera.bits, camera.cfa, camera.black_level_dn) == (10, "RGGB", 42)
    assert camrig.Camera.from_toml(camera.to_toml()).name == "small"
    with pytest.raises(camrig.CamrigError, match="read_e") as raised:
        camera.set({"sensor.noise.raed_e": 1.0})
    assert raised.value.kind == "input" and raised.value.help
    with pytest.raises(TypeError, match="sensor"):
        camera.set(prnu=0.1)


def test_a_camera_goes_to_other_processes(camera):
    own = camera.set({"sensor.noise.read_e": 2.0})
    for again in (pickle.loads(pickle.dumps(own)), copy.deepcopy(own)):
        assert again.to_toml() == own.to_toml() and repr(again) == repr(own)
    text = camrig.Camera.from_toml(own.to_toml()).set(width=32)
    assert pickle.loads(pickle.dumps(text)).shape == (48, 32)
    with pytest.raises(ValueError, match="frames = -1"):
        camera.simulate("uniform:0.18", 0.01, frames=-1)


def test_raw_files(camera, tmp_path):
    frames = camera.simulate("colorchecker", 0.010, lux=300, frames=2)
    camrig.write_raw(tmp_path / "a.tiff", frames, bits=10, cfa="RGGB", black_level_dn=42)
    again, facts = camrig.read_raw(tmp_path / "a.tiff")
    assert np.array_equal(again, frames)
    assert (facts["bits"], facts["cfa"], facts["black_level_dn"]) == (10, "RGGB", 42)
    with pytest.raises(camrig.CamrigError):
        camrig.write_raw(tmp_path / "a.tiff", frames, bits=10)
    with pytest.raises(camrig.CamrigError, match="float64"):
        camrig.write_raw(tmp_path / "b.tiff", frames / 2, bits=10)


def test_presets_and_effects():
    assert {"mt9v024", "imx585-clear-hdr"} <= set(camrig.presets())
    assert "dark current" in camrig.effects()["hot-pixels"]
