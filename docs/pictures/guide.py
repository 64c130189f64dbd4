#!/usr/bin/env python3
"""Makes the pictures of the guide by running its chapters: chart.png, lens-mtf.svg, ...

    pip install numpy pillow playwright scikit-image   # camrig and chromium are in the PATH
    docs/pictures/guide.py WORK-FOLDER [PICTURE...]

Each chapter runs in a folder of its own below the work folder, up to the block that its picture
needs.
"""
import re
import shutil
import subprocess
import sys
from pathlib import Path

from make import drawings
from PIL import Image
from playwright.sync_api import sync_playwright

HERE = Path(__file__).resolve().parent
GUIDE = HERE.parent / "guide"
VIEW = ["camrig", "rig", "view", "emulator:", "--camera", "mt9v024", "--scene", "colorchecker",
        "--lux", "1000", "--exposure", "30ms"]


def run_chapter(name, work, until):
    """Runs the commands of a chapter up to the block that holds `until`; the folder they ran in."""
    folder = work / name
    folder.mkdir(parents=True, exist_ok=True)
    blocks = re.findall(r"```sh\n(.*?)```", (GUIDE / f"{name}.md").read_text(), re.S)
    last = next(i for i, block in enumerate(blocks) if until in block)
    for block in blocks[: last + 1]:
        subprocess.run(["bash", "-euo", "pipefail", "-c", block], cwd=folder, check=True)
    return folder


def keep_drawing(name, page):
    """Keeps the first drawing of a page."""
    (HERE / name).write_text(drawings(page)[0] + "\n")


def keep_picture(name, picture):
    """Keeps a picture in 256 colours, without the dots of dithering."""
    picture = picture.quantize(256, kmeans=1, dither=Image.Dither.NONE)
    picture.save(HERE / name, optimize=True)


def chart(work):
    folder = run_chapter("first-picture", work, "--preview")
    picture = Image.open(folder / "chart.png").convert("RGB")
    picture.thumbnail((560, 420))
    keep_picture("chart.png", picture)


def lens(work):
    folder = run_chapter("lens", work, "lens plot")
    shutil.copy(folder / "drawings/mtf.svg", HERE / "lens-mtf.svg")


def transfer(work):
    folder = run_chapter("sensor", work, "ptc.html")
    keep_drawing("photon-transfer.svg", folder / "ptc.html")


def pixels(work):
    folder = work / "many"
    folder.mkdir(parents=True, exist_ok=True)
    blocks = re.findall(r"```sh\n(.*?)```", (GUIDE / "many.md").read_text(), re.S)
    block = next(block for block in blocks if "pixels.toml" in block)
    subprocess.run(["bash", "-euo", "pipefail", "-c", block], cwd=folder, check=True)
    keep_drawing("pixel-size.svg", folder / "pixels/figures.html")


def diagnosis(work):
    folder = run_chapter("diagnose", work, "camrig diagnose camera.toml captures -o diagnosis")
    keep_drawing("diagnosis.svg", folder / "diagnosis/report.html")


def rig(work):
    """The console, with a browser that waits for some frames."""
    view = subprocess.Popen(VIEW, stdout=subprocess.PIPE, text=True)
    try:
        url = view.stdout.readline().strip()
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(
                executable_path=shutil.which("chromium"), args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": 1280, "height": 860})
            page.goto(url)
            page.wait_for_timeout(15_000)
            page.screenshot(path=work / "view.png")
            browser.close()
    finally:
        view.kill()
    keep_picture("rig-view.png", Image.open(work / "view.png").convert("RGB"))


PICTURES = {
    "chart": chart, "lens": lens, "transfer": transfer, "pixels": pixels, "diagnosis": diagnosis,
    "rig": rig,
}

if __name__ == "__main__":
    work = Path(sys.argv[1])
    work.mkdir(parents=True, exist_ok=True)
    for name in sys.argv[2:] or PICTURES:
        PICTURES[name](work)
