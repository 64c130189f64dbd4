"""Data sets on engines: the files of the program."""

import os

import pytest

import camrig

SWEEP = """
format = "sweep/1"
files = "npy"
frames = 2
pictures_per_tar = 5

[grid]
camera = "small.toml"
scene = ["colorchecker", "ramp"]
exposure_s = 0.01

[random]
count = 3
[random.keys]
lux = { log-range = [10, 1000] }

[clean]
[figures]
snr_db = true
"""


@pytest.fixture
def sweep(camera_file, tmp_path, program):
    path = tmp_path / "sweep.toml"
    path.write_text(SWEEP)
    program("batch", path, "-o", "program")
    return path


def files(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_a_picture_is_made_where_it_is_asked_for(sweep, tmp_path):
    for index in (7, 3, *range(12)):
        camrig.batch._make(index, str(sweep), str(tmp_path / "own"))
    camrig.batch._finish(str(sweep), str(tmp_path / "own"))
    assert files(tmp_path / "own") == files(tmp_path / "program")
    with pytest.raises(camrig.CamrigError, match="sweep file is not the one"):
        sweep.write_text(SWEEP.replace("1000", "2000"))
        camrig.batch._begin(sweep, tmp_path / "own")


def test_dask(sweep, tmp_path):
    distributed = pytest.importorskip("distributed")
    cluster = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with cluster, distributed.Client(cluster) as client:
        camrig.batch.dask(sweep, tmp_path / "own", client)
    assert files(tmp_path / "own") == files(tmp_path / "program")


def test_ray(sweep, tmp_path):
    ray = pytest.importorskip("ray")
    paths = {"PYTHONPATH": os.environ.get("PYTHONPATH", "")}
    ray.init(num_cpus=2, include_dashboard=False, runtime_env={"env_vars": paths})
    try:
        camrig.batch.ray(sweep, tmp_path / "own")
    finally:
        ray.shutdown()
    assert files(tmp_path / "own") == files(tmp_path / "program")
