"""Noise for training: its statistics are the camera's, and it is a function of the seed."""

import os
import time

import numpy as np
import pytest

import camrig
from camrig import augment


def test_statistics_are_those_of_the_camera_file(camera):
    """Mean K(µ + dark) + black, variance K²(σ_read² + σ_row² + µ + dark) + 1/12, and PRNU."""
    own = camera.set({"sensor.noise.prnu": 0.0})
    gain, dark = 1023 / 5000, 20.0 * 0.01
    for mean in (0.0, 100.0, 2000.0):
        frames = augment.expose(np.full((40, 96, 128), mean), own, seeds=range(40))
        assert frames.mean() == pytest.approx(42 + gain * (mean + dark), abs=0.02 + 2e-4 * mean)
        expected = gain**2 * (4.0**2 + 1.0**2 + mean + dark) + 1 / 12
        measured = frames.var(axis=0, ddof=1, dtype=np.float64).mean()
        # 40 x 96 x 128 samples, but 40 x 96 of the rows' noise.
        assert measured == pytest.approx(expected, rel=0.02)


def test_a_frame_is_a_function_of_its_picture_and_seed(camera):
    rng = np.random.default_rng(3)
    pictures = rng.random((3, 20, 30, 3), dtype=np.float32)
    together = augment.noisy(pictures, camera, white_e=3000, seeds=[7, 8, 9])
    alone = augment.noisy(pictures[1:2], camera, white_e=3000, seeds=[8])
    assert np.array_equal(together[1:2], alone)
    other = augment.noisy(pictures[1:2], camera, white_e=3000, seeds=[4])
    assert not np.array_equal(alone, other)


def test_mosaic_takes_the_letter_of_the_place():
    picture = np.broadcast_to(np.array([1.0, 2.0, 3.0]), (1, 4, 4, 3))
    assert augment.mosaic(picture, "GRBG")[0, :2, :2].tolist() == [[2, 1], [3, 2]]
    assert augment.mosaic(picture, "mono").mean() == 2


def test_unprocessing_undoes_the_tone_curve_and_the_gains():
    srgb = np.array([[[0.5, 0.5, 0.5], [1.0, 0.02, 0.0]]])
    raw = augment.unprocess(srgb, white_balance=(2.0, 1.0, 4.0))
    grey = ((0.5 + 0.055) / 1.055) ** 2.4
    assert raw[0, 0] == pytest.approx([grey / 2, grey, grey / 4], rel=1e-5)
    assert raw[0, 1] == pytest.approx([0.5, 0.02 / 12.92, 0], rel=1e-5)
    matrix = np.array([[1.5, -0.3, -0.2], [-0.2, 1.4, -0.2], [0.0, -0.5, 1.5]])
    again = augment.unprocess(srgb, white_balance=(1, 1, 1), colour_matrix=matrix)[0, 0]
    assert again == pytest.approx([grey] * 3, rel=1e-5)


@pytest.mark.parametrize(
    ("means", "seeds", "said"),
    [
        (np.full((1, 4, 4), -1.0), [0], "-1 electrons"),
        (np.full((1, 4, 4), np.nan), [0], "NaN"),
        (np.zeros((2, 4, 4)), [0], "1 seeds of 2"),
    ],
)
def test_what_is_wrong_is_said(camera, means, seeds, said):
    with pytest.raises(camrig.CamrigError, match=said):
        augment.expose(means, camera, seeds=seeds)


def test_sensors_of_several_captures_are_refused():
    camera = camrig.Camera("ox03c10").set(width=32, height=16)
    with pytest.raises(camrig.CamrigError, match="several captures"):
        augment.expose(np.zeros((1, 16, 32)), camera, seeds=[0])


def in_numpy(electrons, camera, seed):
    """The same model in numpy: shot noise, PRNU, dark current, read and row noise, converter."""
    rng = np.random.default_rng(seed)
    count, height, width = electrons.shape
    prnu = 1 + 0.01 * np.random.default_rng(0).standard_normal((height, width))
    charge = rng.poisson(electrons * prnu + 20.0 * 0.01).astype(np.float64)
    charge += 4.0 * rng.standard_normal(electrons.shape)
    charge += rng.standard_normal((count, height, 1))
    charge = np.clip(charge, None, 5000)
    return np.clip(np.rint(camera.black_level_dn + 1023 / 5000 * charge), 0, 1023).astype(np.uint16)


def test_the_same_model_in_numpy_is_slower(camera):
    """How many times is printed (pytest -s), and is no condition: machines differ."""
    means = np.full((2, 768, 1024), 500.0, np.float32)
    own = camera.set(width=1024, height=768)
    seconds = {}
    for name, take in {
        "augment": lambda: augment.expose(means, own, seeds=[0, 1]),
        "numpy": lambda: in_numpy(means, own, 0),
    }.items():
        begun = time.perf_counter()
        frames = take()
        seconds[name] = time.perf_counter() - begun
        assert frames.mean() == pytest.approx(42 + 1023 / 5000 * 500.2, rel=0.01)
    cores = len(os.sched_getaffinity(0))
    print(f"numpy / augment: {seconds['numpy'] / seconds['augment']:.0f} on {cores} cores")
