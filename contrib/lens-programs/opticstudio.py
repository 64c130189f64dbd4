"""Exports a lens from Ansys Zemax OpticStudio for `camrig lens import`.

To run, on a machine with OpticStudio and its ZOS-API (Professional or Premium, 2018 or later), set
the constants below, then:

    pip install pythonnet
    python opticstudio.py LENS.zmx OUTPUT_FOLDER
    camrig lens import OUTPUT_FOLDER -o my-lens

It opens the file in an OpticStudio of its own and never saves it. It leaves ISETPARMS.TXT, the
tables NAME_DI_.dat (height of the chief ray, mm), _RI_.dat (relative illumination) and _CRA_.dat
(chief-ray angle, radians), and a Huygens PSF listing for each height and wavelength.

What it does: active configuration, real ray aiming, one wavelength at a time, fields along y at
even steps of the paraxial image height of the primary wavelength. Vignetting factors are removed,
so that the chief ray goes through the middle of the stop: light is cut by apertures on the surfaces
only. Give the surfaces the apertures that they have (Tools, Convert Semi-Diameters to Circular
Apertures) before the export.

What could not be run where this was written: OpticStudio itself. Names of the ZOS-API follow its
public examples; the files were tested in the layout of listings that OpticStudio wrote. Every
figure is checked for being a number and every PSF for its size; the import compares wavelength and
spacing of each listing with the rest. Two things to look at in the first export:
  - RELI is divided by its value on the axis, as some versions normalise to the brightest field.
  - ImageDelta is reported to be ignored by some versions; the import then refuses the listing.
If a name is not known to your version, or a figure looks wrong, open an issue of camrig with the
version of OpticStudio, what this script printed, ISETPARMS.TXT and the first PSF listing.
"""

import math
import os
import sys

NAME = "lens"  # of the files: letters, digits, - and _
HEIGHTS = 21  # image heights from the axis to the largest field, evenly spaced
MAX_FIELD_DEG = 20.0  # angle of the chief ray at the entrance pupil
WAVELENGTHS_NM = [400, 450, 500, 550, 600, 650, 700]  # rising
PSF_SIZE = 128  # samples per side: 32, 64, 128, 256, 512 or 1024
PSF_SPACING_UM = 0.5
PUPIL_SIZE = max(PSF_SIZE, 128)  # rays across the pupil
RELI_SAMPLES = 30  # rays across the pupil for the relative illumination


def connect():
    """The ZOS-API and an OpticStudio of its own."""
    import winreg

    import clr

    with winreg.OpenKey(winreg.HKEY_CURRENT_USER, r"Software\Zemax") as key:
        root = winreg.QueryValueEx(key, "ZemaxRoot")[0]
    clr.AddReference(os.path.join(root, r"ZOS-API\Libraries\ZOSAPI_NetHelper.dll"))
    import ZOSAPI_NetHelper

    if not ZOSAPI_NetHelper.ZOSAPI_Initializer.Initialize():
        sys.exit("OpticStudio is not found on this machine")
    folder = ZOSAPI_NetHelper.ZOSAPI_Initializer.GetZemaxDirectory()
    clr.AddReference(os.path.join(folder, "ZOSAPI.dll"))
    clr.AddReference(os.path.join(folder, "ZOSAPI_Interfaces.dll"))
    import ZOSAPI

    application = ZOSAPI.ZOSAPI_Connection().CreateNewApplication()
    if application is None or not application.IsValidLicenseForAPI:
        sys.exit("the licence does not allow the ZOS-API")
    return ZOSAPI, application


class Lens:
    """The lens in OpticStudio, with two fields (the axis and one other) and one wavelength, which
    is the primary one, so that a PSF is centred on its own chief ray."""

    def __init__(self, api, system):
        self.api, self.system = api, system
        data = system.SystemData
        if data.Units.LensUnits != api.SystemData.ZemaxSystemUnits.Millimeters:
            sys.exit("the lens is not in millimetres: scale it first (Tools, Scale Lens)")
        if data.Aperture.AFocalImageSpace or data.Aperture.TelecentricObjectSpace:
            sys.exit("the lens is afocal or telecentric on the object's side")
        data.RayAiming.RayAiming = api.SystemData.RayAimingMethod.Real
        self.image = system.LDE.NumberOfSurfaces - 1
        waves = data.Wavelengths
        every = [waves.GetWavelength(i + 1) for i in range(waves.NumberOfWavelengths)]
        self.reference_um = [wave.Wavelength for wave in every if wave.IsPrimary][0]
        while waves.NumberOfWavelengths > 1:
            waves.RemoveWavelength(waves.NumberOfWavelengths)
        waves.GetWavelength(1).MakePrimary()
        waves.GetWavelength(1).Wavelength = self.reference_um
        self.measure()
        self.only_two_fields()

    def measure(self):
        """First-order figures at the reference wavelength; the size of the entrance pupil stays
        as it is there."""
        self.efl = self.operand("EFFL", 0, 1)
        self.f_number, self.working = self.operand("ISFN"), self.operand("WFNO")
        self.distance = self.system.LDE.GetSurfaceAt(0).Thickness
        self.finite = not (math.isinf(self.distance) or self.distance >= 1e10)
        tangent = math.tan(math.radians(MAX_FIELD_DEG))
        self.largest_object = self.magnification = 0.0
        if self.finite:
            self.magnification = self.operand("PMAG", 0, 1)
            self.largest_object = (self.distance + self.operand("ENPP")) * tangent
            self.top = abs(self.magnification * self.largest_object)
        else:
            self.top = abs(self.efl) * tangent
        kinds = self.api.SystemData.ZemaxApertureType
        aperture = self.system.SystemData.Aperture
        if aperture.ApertureType in (kinds.ImageSpaceFNum, kinds.ParaxialWorkingFNum):
            pupil = self.operand("EPDI")
            aperture.ApertureType = kinds.EntrancePupilDiameter
            aperture.ApertureValue = pupil

    def only_two_fields(self):
        fields = self.system.SystemData.Fields
        if any(field.VCX or field.VCY or field.VDX or field.VDY for field in self.all_fields()):
            print("warning: the vignetting factors of the file are removed; only apertures on its "
                  "surfaces cut light")
        while fields.NumberOfFields > 1:
            fields.RemoveField(fields.NumberOfFields)
        kinds = self.api.SystemData.FieldType
        fields.SetFieldType(kinds.ObjectHeight if self.finite else kinds.Angle)
        fields.GetField(1).X = 0.0
        fields.GetField(1).Y = 0.0
        fields.AddField(0.0, 0.0, 1.0)
        fields.ClearVignetting()

    def all_fields(self):
        fields = self.system.SystemData.Fields
        return [fields.GetField(i) for i in range(1, fields.NumberOfFields + 1)]

    def set(self, part, nm, image_below=False):
        """Field 2 at this part of the largest image height, on the side of +y or -y."""
        if self.finite:
            value = part * self.largest_object
            below = self.magnification > 0
        else:
            value = math.degrees(math.atan(part * math.tan(math.radians(MAX_FIELD_DEG))))
            below = self.efl < 0
        self.system.SystemData.Fields.GetField(2).Y = value if below == image_below else -value
        self.system.SystemData.Wavelengths.GetWavelength(1).Wavelength = nm * 1e-3

    def operand(self, name, *arguments):
        """The value of a merit operand: Int1, Int2, then Hx, Hy, Px, Py or its own data."""
        kind = getattr(self.api.Editors.MFE.MeritOperandType, name)
        filled = (list(arguments) + [0] * 8)[:8]
        value = self.system.MFE.GetOperandValue(kind, *filled)
        if not math.isfinite(value):
            sys.exit(f"OpticStudio gives {value} for {name} {arguments}")
        return value

    def figures(self, part, nm):
        """Real image height (mm), relative illumination and chief-ray angle (radians)."""
        self.set(part, nm)
        hy = 1 if part else 0
        height = self.operand("REAY", self.image, 1, 0, hy, 0, 0)
        cosine = self.operand("REAC", self.image, 1, 0, hy, 0, 0)
        axis, light = (self.operand("RELI", RELI_SAMPLES, 1, field, 0) for field in (1, 2))
        if axis <= 0:
            sys.exit(f"no light on the axis at {nm} nm")
        return height, light / axis, math.acos(min(1.0, abs(cosine)))

    def psf(self, part, nm, path):
        """Writes the listing of a Huygens PSF. The image lies at -y, so that the listing's rows,
        from +y down, run away from the axis."""
        self.set(part, nm, image_below=True)
        analysis = self.system.Analyses.New_HuygensPsf()
        settings = self.api.Analysis.Settings.Psf.IAS_HuygensPsf(analysis.GetSettings())
        sizes = self.api.Analysis.SampleSizes
        settings.PupilSampleSize = getattr(sizes, f"S_{PUPIL_SIZE}x{PUPIL_SIZE}")
        settings.ImageSampleSize = getattr(sizes, f"S_{PSF_SIZE}x{PSF_SIZE}")
        settings.ImageDelta = PSF_SPACING_UM
        settings.Field.SetFieldNumber(2)
        settings.Wavelength.SetWavelengthNumber(1)
        settings.UsePolarization = False
        settings.UseCentroid = False
        settings.Normalize = False
        analysis.ApplyAndWaitForCompletion()
        results = analysis.GetResults()
        grid = results.GetDataGrid(0)
        if (grid.Nx, grid.Ny) != (PSF_SIZE, PSF_SIZE):
            sys.exit(f"OpticStudio made a PSF of {grid.Nx} x {grid.Ny} samples, not {PSF_SIZE}")
        if not results.GetTextFile(path):
            sys.exit(f"OpticStudio could not write {path}")
        analysis.Close()


def export(lens, source, folder):
    base = os.path.join(folder, NAME)
    parts = [i / (HEIGHTS - 1) for i in range(HEIGHTS)]
    rows = [[lens.figures(part, nm) for nm in WAVELENGTHS_NM] for part in parts]
    for column, kind in enumerate(("DI", "RI", "CRA")):
        with open(f"{base}_{kind}_.dat", "w") as file:
            for row in rows:
                file.write(" ".join(f"{point[column]:.8E}" for point in row) + "\n")
    parameters = {
        "lensFile": f"'{os.path.basename(source)}'",
        "psfSize": PSF_SIZE,
        "psfSpacing": f"{PSF_SPACING_UM * 1e-3:.9f}",
        "wave": f"[{' '.join(map(str, WAVELENGTHS_NM))}]",
        "imgHeightNum": HEIGHTS,
        "imgHeightMax": f"{lens.top:.9f}",
        "objDist": f"{min(lens.distance, 1e10):.6f}",
        "mag": f"{lens.magnification:.9f}",
        "baseLensFileName": f"'{NAME}'",
        "refWave": f"{lens.reference_um * 1e3:.6f}",
        "fov": MAX_FIELD_DEG,
        "efl": f"{lens.efl:.9f}",
        "fnumber_eff": f"{lens.working:.9f}",
        "fnumber": f"{lens.f_number:.9f}",
    }
    with open(os.path.join(folder, "ISETPARMS.TXT"), "w") as file:
        file.writelines(f"{name}={value};\n" for name, value in parameters.items())
    for i, part in enumerate(parts):
        for j, nm in enumerate(WAVELENGTHS_NM):
            print(f"PSF at {part * lens.top:.4f} mm, {nm} nm")
            lens.psf(part, nm, f"{base}_2D_PSF_Fld{i + 1}_Wave{j + 1}.dat")


def main():
    if len(sys.argv) != 3:
        sys.exit(f"usage: python {sys.argv[0]} LENS.zmx OUTPUT_FOLDER")
    source, folder = (os.path.abspath(path) for path in sys.argv[1:])
    os.makedirs(folder, exist_ok=True)
    api, application = connect()
    try:
        system = application.PrimarySystem
        if not system.LoadFile(source, False):
            sys.exit(f"OpticStudio could not open {source}")
        export(Lens(api, system), source, folder)
    finally:
        application.CloseApplication()
    print(f"camrig lens import {folder} -o {NAME}")


if __name__ == "__main__":
    main()
