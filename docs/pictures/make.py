#!/usr/bin/env python3
"""Makes opening.png, the picture at the head of the README, from outputs of camrig.

    pip install numpy pillow playwright scikit-image   # camrig and chromium are in the PATH
    docs/pictures/make.py WORK-FOLDER

The scene is "coffee" of scikit-image, a photograph by Rachel Michetti, courtesy of Pikolo Espresso
Bar, CC0. A photograph has no spectra: each pixel gets the smoothest one of its colour under D65.
"""
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import skimage
from PIL import Image
from playwright.sync_api import sync_playwright

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
WORK = Path(sys.argv[1])
BANDS = np.arange(400, 701, 10)
MEASURED = [
    ("read noise", "read_e", "read_noise_e", "e⁻"),
    ("dark current", "dark_current_e_per_s", "dark_current_e_per_s", "e⁻/s"),
    ("DSNU", "dsnu_e_per_s", "dsnu_e_per_s", "e⁻/s"),
    ("PRNU", "prnu", "prnu", "%"),
]


def camrig(*words):
    """Runs camrig in the work folder and returns what it printed."""
    done = subprocess.run(["camrig", *words], cwd=WORK, check=True, stdout=subprocess.PIPE)
    return done.stdout.decode()


def table(name):
    """A table of wavelengths and columns, at the bands."""
    text = (ROOT / "host/crates/light/src/data" / name).read_text()
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    return np.stack([np.interp(BANDS, rows[:, 0], column) for column in rows.T[1:]], axis=1)


def smoothest_spectra():
    """The smoothest spectra whose colours under D65 are red, green and blue of sRGB."""
    d65 = table("daylight.csv") @ [1.0, -0.2960, -0.6890]
    rgb_of_xyz = [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
    rgb = np.array(rgb_of_xyz) @ (table("cie1931.csv").T * d65)
    rgb /= rgb.sum(axis=1, keepdims=True)
    steps = np.diff(np.eye(len(BANDS)), axis=0)
    system = np.block([[steps.T @ steps, rgb.T], [rgb, np.zeros((3, 3))]])
    right = np.vstack([np.zeros((len(BANDS), 3)), np.eye(3)])
    return np.linalg.solve(system, right)[: len(BANDS)]


def write_scene():
    photograph = Image.open(Path(skimage.__file__).parent / "data/coffee.png").convert("RGB")
    code = np.asarray(photograph) / 255
    linear = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    cube = np.clip(linear @ smoothest_spectra().T, 0, 1)
    np.save(WORK / "coffee.npy", cube.astype(np.float32))
    (WORK / "coffee.toml").write_text("start_nm = 400\nstep_nm = 10\n")


def write_camera():
    """The sensor of mt9t012 with fewer, larger pixels behind the phone lens of the guide."""
    guide = (ROOT / "docs/guide/lens.md").read_text()
    lens = re.search(r"cat > phone.toml <<'END'\n(.*?)END\n", guide, re.S)[1]
    (WORK / "phone.toml").write_text(lens)
    for table_of_preset in ["mt9m131-qe.csv", "ir-cut-690.csv"]:
        (WORK / table_of_preset).write_text(camrig("presets", table_of_preset))
    sensor = camrig("presets", "mt9t012")
    sensor = re.sub(r"\[lens\].*?\n\n", "", sensor, flags=re.S)
    sensor = re.sub(r"^name.*\n", "", sensor, flags=re.M)
    for key, value in [("width", 600), ("height", 400), ("pitch_um", 7.0)]:
        sensor = re.sub(rf"^{key} = .*$", f"{key} = {value}", sensor, flags=re.M)
    lens = '[lens]\nkind = "prescription"\nfile = "phone.toml"\nfocus_mtf_per_mm = 40\n\n'
    (WORK / "camera.toml").write_text(lens + sensor)


def write_raw_pictures():
    """The raw frame brightened, and a part of it magnified in the colours of the filters."""
    raw = np.load(WORK / "coffee-raw.npy").astype(float)
    raw = raw.reshape(raw.shape[-2:])
    bright = np.clip((raw - 42) / (1023 - 42), 0, 1) ** (1 / 2.2)
    Image.fromarray((255 * bright).astype(np.uint8)).save(WORK / "raw.png")
    part = bright[70:94, 378:414]
    color = np.zeros((*part.shape, 3))
    for row, column, channel in [(0, 0, 1), (0, 1, 0), (1, 0, 2), (1, 1, 1)]:  # GRBG
        color[row::2, column::2, channel] = part[row::2, column::2]
    Image.fromarray((255 * color).astype(np.uint8)).resize((432, 288), 0).save(WORK / "part.png")


def measured_rows():
    """Rows of a table: what the camera file says, and what was measured on captures."""
    measured = json.loads(camrig("measure", "ptc", "captures", "--json"))
    preset = camrig("presets", "mt9t012")
    rows = ""
    for name, key, figure, unit in MEASURED:
        scale = 100 if unit == "%" else 1
        true = scale * float(re.search(rf"^{key} = (.*)$", preset, re.M)[1])
        value, error = (scale * measured[figure][part] for part in ("value", "std_error"))
        digits = -int(np.floor(np.log10(error)))
        rows += f"<tr><td>{name}, {unit}<td>{true}<td>{value:.{digits}f} ± {error:.{digits}f}\n"
    return rows


def drawings(page):
    """The drawings of a page as files of their own, as the button of each saves it."""
    found = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        view = browser.new_page()
        view.goto(Path(page).resolve().as_uri())
        for button in view.locator("figure.plot .tools button", has_text="SVG").all():
            with view.expect_download() as download:
                button.dispatch_event("click")
            found.append(Path(download.value.path()).read_text())
        browser.close()
    return found


def plot(svg, top):
    """A drawing of camrig without its title and legend, which end at `top`, as wide as its place."""
    width, height = re.search(r'viewBox="0 0 (\d+) (\d+)"', svg).groups()
    place = f'viewBox="0 {top} {width} {int(height) - top}"'
    return re.sub(r'viewBox="[^"]*" width="\d+" height="\d+"', place, svg, count=1)


def save_with_palette(page, path):
    """Saves with 256 colours, of which those of the plots get as many as the photograph's."""
    colors = np.unique(np.asarray(page).reshape(-1, 3) // 15, axis=0).astype(np.uint8) * 15
    palette = Image.fromarray(colors[None]).quantize(256, kmeans=1)
    page = page.quantize(palette=palette)
    entries = np.array(page.getpalette()).reshape(-1, 3)
    entries[entries.sum(axis=1).argmax()] = 255
    page.putpalette(entries.ravel().tolist())
    page.save(path, optimize=True)


def main():
    WORK.mkdir(parents=True, exist_ok=True)
    write_scene()
    write_camera()
    camrig("scene", "show", "coffee.npy", "-o", "scene.png", "--force")
    camrig("simulate", "--camera", "./camera.toml", "--scene", "coffee.npy", "--exposure", "auto",
           "--psf-tolerance", "0.05", "-o", "coffee.dng", "--force")
    camrig("convert", "coffee.dng", "finished.png", "--preview", "--force")
    camrig("convert", "coffee.dng", "coffee-raw.npy", "--force")
    camrig("lens", "plot", "phone.toml", "--focus-mtf", "40", "-o", "drawings", "--force")
    camrig("capture", "--camera", "mt9t012", "--plan", "ptc", "--size", "128,96", "-o", "captures",
           "--force")
    camrig("measure", "ptc", "captures", "--report", "ptc.html", "--force")
    write_raw_pictures()
    page = (HERE / "opening.html").read_text()
    page = page.replace("{PSF}", plot((WORK / "drawings/psf.svg").read_text(), 18))
    page = page.replace("{TRANSFER}", plot(drawings(WORK / "ptc.html")[0], 18))
    page = page.replace("{MEASURED}", measured_rows())
    (WORK / "opening.html").write_text(page)
    subprocess.run(["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
                    "--window-size=920,600", "--force-device-scale-factor=1.5",
                    f"--screenshot={WORK / 'page.png'}",
                    (WORK / "opening.html").resolve().as_uri()],
                   check=True, timeout=120)
    page = Image.open(WORK / "page.png").convert("RGB")
    save_with_palette(page, HERE / "opening.png")


if __name__ == "__main__":
    main()
