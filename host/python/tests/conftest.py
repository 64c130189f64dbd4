"""A small camera, and the program to compare with."""

import os
import subprocess
import sys

import pytest

import camrig

CAMERA = """
name = "small"

[lens]
kind = "diffraction-limited"
f_number = 2.8
focal_length_mm = 4.0

[sensor]
width = 64
height = 48
pitch_um = 3.0
fill_factor = 1.0
cfa = "RGGB"
bits = 10
black_level_dn = 42
full_well_e = 5000
qe = 0.5

[sensor.noise]
read_e = 4.0
dark_current_e_per_s = 20.0
prnu = 0.01

[[effect]]
kind = "row-temporal-noise"
sigma_e = 1.0
"""


PLAN = """
format = "plan/1"
[[stack]]
id = "dark"
role = "dark"
frames = 8
exposure_s = [0.001, 0.01]
[[stack]]
id = "flat"
role = "flat"
frames = 8
exposure_s = 0.01
fill = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]
light = { wavelength_nm = 550.0 }
"""


@pytest.fixture
def camera_file(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(CAMERA)
    return path


@pytest.fixture
def camera(camera_file):
    return camrig.Camera(camera_file)


@pytest.fixture
def program(tmp_path):
    """Runs the program in a folder of the test; its standard output."""

    def run(*arguments):
        command = [sys.executable, "-m", "camrig", *map(str, arguments)]
        done = subprocess.run(
            command, cwd=tmp_path, env=os.environ, capture_output=True, text=True, timeout=120
        )
        assert done.returncode in (0, 1), done.stderr
        return done.stdout

    return run


@pytest.fixture
def folder(camera_file, program, tmp_path):
    """A capture set of the camera: darks and flats."""
    (tmp_path / "plan.toml").write_text(PLAN)
    program("capture", "--camera", "small.toml", "--plan", "plan.toml", "-o", "set")
    return tmp_path / "set"
