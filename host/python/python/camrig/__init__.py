"""Camera-system simulator: spectral scene, lens, sensor, Bayer raw.

Everything that the program computes for the same input is the same here, byte for byte. Long calls
release the interpreter's lock, take ``progress`` (a function of what, done and total) and end with
Ctrl-C. Errors are :class:`CamrigError` with ``kind``, ``what``, ``where``, ``help`` and ``code``.

Examples
--------
>>> import camrig
>>> camera = camrig.Camera("mt9v024").set(width=320, height=240)
>>> raw = camera.simulate("colorchecker", exposure=0.010, lux=300)
>>> raw.shape, raw.dtype.name
((240, 320), 'uint16')
"""

from . import augment, batch, measure, plot
from ._camera import Camera
from ._camrig import CamrigError, Irradiance, __version__, effects, presets, read_raw, write_raw
from ._captures import Captures, Diagnosis, Fitted, compare, diagnose, fit

__all__ = [
    "Camera",
    "CamrigError",
    "Captures",
    "Diagnosis",
    "Fitted",
    "Irradiance",
    "__version__",
    "augment",
    "batch",
    "compare",
    "diagnose",
    "effects",
    "fit",
    "measure",
    "plot",
    "presets",
    "read_raw",
    "write_raw",
]
