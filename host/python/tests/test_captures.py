"""Measurements and diagnoses of arrays are those of the same frames in files."""

import json

import numpy as np
import pytest

import camrig

# DN per electron: the codes over the full well.
GAIN = 1023 / 5000

@pytest.fixture
def arrays(folder):
    """The set as arrays with the conditions of its manifest."""
    tomllib = pytest.importorskip("tomllib")
    manifest = tomllib.loads((folder / "captures.toml").read_text())
    sensor = manifest["sensor"]
    stacks = {}
    for capture in manifest["capture"]:
        files = capture.pop("files")
        names = sorted(folder.glob(files)) if isinstance(files, str) else map(folder.joinpath, files)
        frames = [camrig.read_raw(name)[0] for name in names]
        frames = np.concatenate([f.reshape(-1, *f.shape[-2:]) for f in frames])
        name = capture.pop("id")
        stacks[name] = {"frames": frames, **capture}
    size = {"width", "height"}
    return stacks, {key: value for key, value in sensor.items() if key not in size}


def test_figures_of_arrays_are_those_of_files(arrays, folder, program):
    stacks, sensor = arrays
    captures = camrig.Captures(stacks, **sensor)
    assert captures.shape == (48, 64) and len(captures.ids) == 10
    for name, own in [
        ("ptc", camrig.measure.ptc(captures)),
        ("emva", camrig.measure.emva(captures)),
        ("dark", camrig.measure.dark(captures)),
    ]:
        assert own == json.loads(program("measure", name, folder, "--json")), name
    of_folder = camrig.Captures.load(folder)
    assert camrig.measure.ptc(of_folder) == camrig.measure.ptc(captures)
    gain = camrig.measure.ptc(captures)["system_gain_dn_per_e"]
    assert abs(gain["value"] - GAIN) < 5 * gain["std_error"]


def test_a_diagnosis_of_arrays_is_that_of_files(arrays, folder, program, camera):
    stacks, sensor = arrays
    captures = camrig.Captures(stacks, **sensor)
    without = camera.set({"effect.row-temporal-noise.sigma_e": 0.0})
    assert camrig.compare(without, captures) == camrig.compare(without, camrig.Captures.load(folder))
    told = []
    found = camrig.diagnose(without, captures, progress=lambda *step: told.append(step))
    assert "row-temporal-noise" in [step["effect"] for step in found.steps]
    assert camrig.Camera.from_toml(found.toml).name == "small"
    assert any(total for _, _, total in told)
    fitted = camrig.fit(captures, name="own")
    well = fitted.values["sensor.full_well_e"]
    assert abs(well["value"] - 5000) < 5 * well["std_error"] and 'name = "own"' in fitted.toml


def test_real_darks_in_one_call():
    """A stack of frames alone: read noise without any metadata."""
    rng = np.random.default_rng(1)
    frames = np.clip(np.round(rng.normal(64, 3, (24, 100, 120))), 0, 1023).astype(np.uint16)
    noise = camrig.measure.dark(frames, bits=10)["read_noise_dn"]
    assert abs(noise["value"] - 3) < 5 * noise["std_error"] and noise["unit"] == "DN"


def test_edges(camera):
    edge = camera.set({"sensor.cfa": "mono"}, width=120, height=120)
    frame = edge.simulate("slanted-edge:angle=5", "auto", lux=1000)
    found = camrig.measure.mtf(frame, pitch_um=3.0, regions=[(30, 30, 60, 60)])["edges"][0]
    assert 0.2 < found["mtf50_cycles_per_pixel"]["value"] < 0.7


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"frames": np.zeros((2, 4, 4))}, "uint16"),
        ({"frames": np.zeros(5, np.uint16)}, "uint16"),
        ({"frames": np.zeros((0, 4, 4), np.uint16)}, "0 samples"),
        ({"frames": np.zeros((4, 4, 8), np.uint16)[..., ::2]}, "C order"),
        ({"frames": [[1, 2]]}, "list"),
        ({"frames": np.full((2, 4, 4), 4096, np.uint16)}, "4096"),
        ({"exposure_s": -1.0}, "exposure_s"),
        ({"exposure_s": float("nan")}, "exposure_s"),
        ({"role": "drak"}, "drak"),
        ({"lihgt": {"lux": 3}}, "lihgt"),
        ({"light": {"lux": 3}}, "light"),
    ],
)
def test_what_is_wrong_is_said(change, said):
    stack = {"frames": np.zeros((2, 4, 4), np.uint16), "role": "dark", "exposure_s": 0.01}
    with pytest.raises(camrig.CamrigError, match=said) as raised:
        camrig.Captures({"dark": {**stack, **change}}, bits=12)
    assert raised.value.what


@pytest.mark.parametrize("dn_per_e", [0, -1.0, float("nan"), float("inf")])
def test_a_gain_is_above_zero(dn_per_e):
    frames = np.zeros((2, 16, 16), np.uint16)
    with pytest.raises(ValueError, match="dn_per_e"):
        camrig.measure.dark(frames, dn_per_e=dn_per_e)


def test_arguments_of_another_class():
    with pytest.raises(TypeError, match="Captures"):
        camrig.measure.ptc(np.zeros((2, 4, 4), np.uint16))
    with pytest.raises(ValueError, match="'Z'"):
        camrig.measure.mtf(np.zeros((40, 40), np.uint16), cfa="RGGB", channels=["Z"])


def test_frames_of_two_sizes():
    stack = {"role": "dark", "exposure_s": 0.01}
    sizes = {str(n): {"frames": np.zeros((1, n, n), np.uint16), **stack} for n in (4, 6)}
    with pytest.raises(camrig.CamrigError, match="4 x 4"):
        camrig.Captures(sizes, bits=12)
