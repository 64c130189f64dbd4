"""A stand-in for OpticStudio's ZOS-API that answers from a lens directory of camrig: it runs
contrib/lens-programs/opticstudio.py, so that a test sees what the script leaves.

usage: python3 zosapi.py SCRIPT LENS_DIRECTORY MAX_FIELD_DEG OUTPUT_FOLDER
"""

import math
import runpy
import struct
import sys
import types


def npy(path):
    """Shape and values of a little-endian array of f4 or f8."""
    data = open(path, "rb").read()
    (size,) = struct.unpack("<H", data[8:10])
    header = eval(data[10 : 10 + size])
    kind = {"<f4": "f", "<f8": "d"}[header["descr"]]
    body = data[10 + size :]
    return header["shape"], struct.unpack(f"<{len(body) // struct.calcsize(kind)}{kind}", body)


class Lens:
    def __init__(self, folder, max_field_deg):
        import tomllib

        self.max_field_deg = max_field_deg
        with open(folder + "/lens.toml", "rb") as file:
            self.about = tomllib.load(file)
        (self.heights, self.waves), self.height = npy(folder + "/distortion.npy")
        _, self.light = npy(folder + "/relative_illumination.npy")
        _, self.angle = npy(folder + "/chief_ray_angle.npy")
        shape, self.psf = npy(folder + "/psf.npy")
        self.size = shape[-1]


class Any:
    """An object with the attributes that it is given."""

    def __init__(self, **values):
        self.__dict__.update(values)


class Names:
    """An enumeration whose members are their own names."""

    def __getattr__(self, name):
        return name


class Several:
    """Wavelengths or fields, counted from 1."""

    def __init__(self, items):
        self.items = items

    def remove(self, number):
        del self.items[number - 1]


class Wavelengths(Several):
    NumberOfWavelengths = property(lambda self: len(self.items))

    def GetWavelength(self, number):
        return self.items[number - 1]

    RemoveWavelength = Several.remove


class Fields(Several):
    NumberOfFields = property(lambda self: len(self.items))
    kind = None

    def GetField(self, number):
        return self.items[number - 1]

    RemoveField = Several.remove

    def SetFieldType(self, kind):
        self.kind = kind

    def AddField(self, x, y, weight):
        self.items.append(Any(X=x, Y=y, VCX=0, VCY=0, VDX=0, VDY=0))

    def ClearVignetting(self):
        pass


class System:
    def __init__(self, lens):
        self.lens = lens
        waves = [Any(Wavelength=um, IsPrimary=um == 0.5876, MakePrimary=lambda: None)
                 for um in (0.4861, 0.5876, 0.6563)]
        field = Any(X=0.0, Y=lens.max_field_deg, VCX=0.1, VCY=0, VDX=0, VDY=0)
        self.SystemData = Any(
            Units=Any(LensUnits="Millimeters"),
            Aperture=Any(AFocalImageSpace=False, TelecentricObjectSpace=False,
                         ApertureType="ImageSpaceFNum", ApertureValue=5.0),
            RayAiming=Any(RayAiming="Off"),
            Wavelengths=Wavelengths(waves),
            Fields=Fields([field]),
        )
        self.LDE = Any(NumberOfSurfaces=4, GetSurfaceAt=lambda i: Any(Thickness=math.inf))
        self.MFE = Any(GetOperandValue=self.operand)
        self.Analyses = Any(New_HuygensPsf=lambda: Psf(self))

    def LoadFile(self, path, save):
        return not save

    def place(self):
        """Number of the height and of the wavelength, and the side of the image."""
        deg = self.SystemData.Fields.GetField(2).Y
        um = self.SystemData.Wavelengths.GetWavelength(1).Wavelength
        part = math.tan(math.radians(abs(deg))) / math.tan(math.radians(self.lens.max_field_deg))
        waves = self.lens.about["wavelengths_nm"]
        wave = min(range(len(waves)), key=lambda w: abs(waves[w] - um * 1e3))
        assert abs(waves[wave] - um * 1e3) < 1e-6, um
        return round(part * (self.lens.heights - 1)), wave, -1 if deg < 0 else 1

    def operand(self, kind, *arguments):
        efl, f_number = self.lens.about["efl_mm"], self.lens.about["f_number"]
        known = {"EFFL": efl, "ISFN": f_number, "WFNO": f_number, "EPDI": efl / f_number}
        if kind in known:
            return known[kind]
        assert self.SystemData.RayAiming.RayAiming == "Real"
        assert self.SystemData.Aperture.ApertureType == "EntrancePupilDiameter"
        assert self.SystemData.Fields.kind == "Angle"
        height, wave, side = self.place()
        at = height * self.lens.waves + wave
        if kind == "RELI":
            # Normalised to the brightest field, which is not the axis.
            return 0.8 * (self.lens.light[at] if arguments[2] == 2 else 1.0)
        surface, number, hx, hy, px, py = arguments[:6]
        assert (surface, number, hx, px, py) == (3, 1, 0, 0, 0) and hy == (1 if height else 0)
        if kind == "REAY":
            return side * self.lens.height[at]
        assert kind == "REAC", kind
        return math.cos(math.radians(self.lens.angle[at]))


class Psf:
    def __init__(self, system):
        self.system = system
        self.settings = Any(
            Field=Any(SetFieldNumber=lambda n: None),
            Wavelength=Any(SetWavelengthNumber=lambda n: None),
        )

    def GetSettings(self):
        return self.settings

    def ApplyAndWaitForCompletion(self):
        assert self.settings.ImageSampleSize == "S_%dx%d" % ((self.system.lens.size,) * 2)

    def GetResults(self):
        size = self.system.lens.size
        return Any(GetDataGrid=lambda i: Any(Nx=size, Ny=size), GetTextFile=self.write)

    def write(self, path):
        lens = self.system.lens
        height, wave, side = self.system.place()
        n = lens.size
        start = (height * lens.waves + wave) * n * n
        rows = [lens.psf[start + i * n : start + (i + 1) * n] for i in range(n)]
        # Stored rows run away from the axis; a listing's run from +y down.
        assert side < 0 or height == 0
        y = side * lens.height[height * lens.waves + wave]
        lines = [
            "Listing of Huygens PSF Data", "", "File : lens.zmx", "Title: ", "",
            f"{lens.about['wavelengths_nm'][wave] * 1e-3:.4f} µm at 0.0000 (deg).",
            f"Data spacing is {self.settings.ImageDelta:.3f} µm.",
            "Strehl ratio: 0.5", f"Pupil grid size: {self.settings.PupilSampleSize[2:]}",
            f"Image grid size: {n} by {n}", f"Center point is: {n // 2 + 1}, {n // 2 + 1}",
            f"Center coordinates  :   0.00000000E+00,  {y:.8E} Millimeters",
            "Values are not normalized to peak = 1.0.", "",
        ] + ["\t".join(f"{value:.4E}" for value in row) for row in rows]
        with open(path, "w", encoding="utf-16", newline="\r\n") as file:
            file.write("\n".join(lines) + "\n")
        return True

    def Close(self):
        pass


def main():
    script, folder, max_field_deg, output = sys.argv[1:]
    lens = Lens(folder, float(max_field_deg))
    application = Any(IsValidLicenseForAPI=True, PrimarySystem=System(lens),
                      CloseApplication=lambda: None)

    class Key:
        def __enter__(self):
            return self

        def __exit__(self, *error):
            return False

    modules = {
        "winreg": dict(HKEY_CURRENT_USER=0, OpenKey=lambda *a: Key(),
                       QueryValueEx=lambda *a: (r"C:\Zemax", 1)),
        "clr": dict(AddReference=lambda name: None),
        "ZOSAPI_NetHelper": dict(ZOSAPI_Initializer=Any(
            Initialize=lambda: True, GetZemaxDirectory=lambda: "C:")),
        "ZOSAPI": dict(
            ZOSAPI_Connection=lambda: Any(CreateNewApplication=lambda: application),
            SystemData=Any(ZemaxSystemUnits=Names(), RayAimingMethod=Names(),
                           ZemaxApertureType=Names(), FieldType=Names()),
            Editors=Any(MFE=Any(MeritOperandType=Names())),
            Analysis=Any(SampleSizes=Names(),
                         Settings=Any(Psf=Any(IAS_HuygensPsf=lambda settings: settings))),
        ),
    }
    for name, values in modules.items():
        module = types.ModuleType(name)
        module.__dict__.update(values)
        sys.modules[name] = module
    sys.argv = [script, "lens.zmx", output]
    runpy.run_path(script, run_name="__main__")


if __name__ == "__main__":
    main()
