"""Writes the MATLAB fixtures of scene files in ISETCam's documented layout (sceneToFile), with
independent writers: scipy.io for version 5, h5py for 7.3. No original ISETCam scene file is used.
Needs numpy, scipy, h5py, Pillow; run in this directory.

The scene: 2 rows, 3 columns, 4 bands (400, 500, 600, 700 nm), reflectance
(1 + x + 3 y + band) / 10, under 1e15 (1 + band) photons."""
import h5py
import numpy as np
import scipy.io

wave = np.array([400.0, 500.0, 600.0, 700.0])
y, x, b = np.mgrid[0:2, 0:3, 0:4]
reflectance = (1 + x + 3 * y + b) / 10
white = 1e15 * (1 + np.arange(4))
photons = reflectance * white
light = dict(type="illuminant", name="q", spectrum=dict(wave=wave), data=dict(photons=white))

scipy.io.savemat("photons_v5.mat", dict(photons=photons.astype(np.float32), wave=wave.astype(np.int16),
    comment="fixture", illuminant=light, fov=10.0, dist=1.2, name="s"), do_compression=True)

flat = photons.reshape(-1, 4)
mean = flat.mean(0)
basis = np.linalg.svd(flat - mean, full_matrices=False)[2].T[:, :2]
energy = white * 6.62607015e-34 * 299792458.0 / (wave * 1e-9)
scipy.io.savemat("model_v5.mat", dict(mcCOEF=((flat - mean) @ basis).reshape(2, 3, 2),
    basis=dict(basis=basis, wave=wave), imgMean=mean, comment="fixture",
    illuminant=dict(data=energy[:, None], wavelength=wave)), do_compression=False)

with h5py.File("photons_v73.mat", "w", userblock_size=512, libver="earliest") as f:
    f.create_dataset("photons", data=photons.transpose(2, 1, 0), chunks=(1, 3, 2), compression="gzip", shuffle=True)
    f.create_dataset("wave", data=wave[:, None])
    f.create_dataset("illuminant/spectrum/wave", data=wave[:, None])
    f.create_dataset("illuminant/data/photons", data=white[:, None])
    f.create_dataset("comment", data=np.frombuffer("fixture".encode("utf-16le"), np.uint16)[:, None])
with open("photons_v73.mat", "r+b") as f:
    f.write(b"MATLAB 7.3 MAT-file, fixture".ljust(124) + bytes([0, 2]) + b"IM")

# The same scene as plain arrays: rows, columns, bands beside a picture and a mask; version 7.3 as
# ICVL's and ARAD's sets have it; HDF5 with the array in a group, bands first.
counts = np.round(reflectance * 1000)
scipy.io.savemat("array_v5.mat", dict(hsi=counts.astype(np.uint16), rgb=counts[:, :, :3], lbl=np.ones((2, 3)),
    wavelengths=wave / 1000), do_compression=True)
with h5py.File("array_v73.mat", "w", userblock_size=512, libver="earliest") as f:
    f.create_dataset("rad", data=counts.transpose(2, 1, 0).astype(np.float32), chunks=(2, 3, 2), compression="gzip")
    f.create_dataset("bands", data=wave[None, :])
with open("array_v73.mat", "r+b") as f:
    f.write(b"MATLAB 7.3 MAT-file, fixture".ljust(124) + bytes([0, 2]) + b"IM")
with h5py.File("array.h5", "w", libver="earliest") as f:
    f.create_dataset("scene/cube", data=counts.transpose(2, 0, 1).astype(np.int16))
    f.create_dataset("scene/wavelength", data=wave)
    f.create_dataset("other", data=counts.astype(np.float32))
# As NeXus files have it: links by path, of which one leads nowhere; half precision; widths of
# bands before their wavelengths.
with h5py.File("links.h5", "w", libver="earliest") as f:
    f.create_dataset("entry/data/cube", data=(reflectance / 4).astype(">f2"))
    f.create_dataset("entry/data/bandwidth_nm", data=np.array([2.5, 2.6, 2.7, 2.8]))
    f.create_dataset("entry/data/centre", data=wave)
    f["entry/cube"] = h5py.SoftLink("/entry/data/cube")
    f["gone"] = h5py.SoftLink("/nowhere")

# Pictures, by Pillow: one colour of sRGB, and one of four inks.
from PIL import Image
Image.new("RGB", (16, 8), (122, 82, 64)).save("colour.jpg", quality=95, subsampling=0)
Image.new("CMYK", (8, 8), (10, 20, 30, 40)).save("cmyk.jpg", quality=50)
