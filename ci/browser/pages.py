"""Looks at camrig's pages in Chromium: python3 pages.py CHROMIUM FOLDER-OF-SCREENSHOTS PAGE...

Each page on a phone (390 px) and a desk, in light, in the dark and in print: no word on the console, nothing
asked of the network, and the checks of checks.js: overflow, text over data, contrast, labels, the script of figures.
"""

import pathlib
import sys
from playwright.sync_api import sync_playwright

# The same checks as of `camrig_testing::browser`, as a function without arguments.
FILE = pathlib.Path(__file__).parents[2] / "host/crates/testing/src/browser/checks.js"
CHECKS = "() => (" + FILE.read_text().split("\n", 1)[1].strip() + ")(window)"


def of_console(complaints):
    """Those of a page that a rig's console serves: it may ask its own server for its parts."""
    return [what for what in complaints if not what.startswith("a request: http://127.0.0.1:")]


def main(chromium, folder, pages):
    wrong = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        for page in map(pathlib.Path, pages):
            for width, scheme, media in [(390, "light", "screen"), (390, "dark", "screen"),
                                         (1280, "light", "screen"), (1280, "dark", "screen"), (794, "light", "print")]:
                view = browser.new_page(viewport={"width": width, "height": 844}, color_scheme=scheme)
                said = []
                view.on("console", lambda m: said.append(f"console: {m.text}"))
                view.on("pageerror", lambda e: said.append(f"error: {e}"))
                view.on("request", lambda r: None if r.url.startswith(("file:", "data:")) else said.append(f"network: {r.url}"))
                view.emulate_media(media=media, color_scheme=scheme)
                view.goto(page.resolve().as_uri())
                said += view.evaluate(CHECKS)
                name = f"{page.parent.name}-{page.stem}-{width}-{scheme}-{media}.png"
                view.screenshot(path=f"{folder}/{name}", full_page=True)
                wrong += [f"{page.name} at {width} px, {scheme}, {media}: {what}" for what in said]
                view.close()
        browser.close()
    for line in wrong:
        print("FAILED:", line)
    print(f"{len(pages)} pages looked at, {len(wrong)} complaints; screenshots in {folder}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2], sys.argv[3:]))
