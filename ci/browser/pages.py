"""Looks at camrig's pages in Chromium: python3 pages.py CHROMIUM FOLDER-OF-SCREENSHOTS PAGE...

Each page on a phone (390 px) and a desk, in light, in the dark and in print: no word on the console, nothing
asked of the network, no overflow to the side, every picture decoded, no text of a drawing outside it, text
that can be told from its paper.
"""

import pathlib
import sys
from playwright.sync_api import sync_playwright

CHECKS = """() => {
  const wrong = [];
  const root = document.documentElement;
  if (root.scrollWidth > window.innerWidth) {
    const wide = [...document.querySelectorAll('body *')].filter(
      e => e.getBoundingClientRect().right > window.innerWidth + 1 && !e.closest('.scroll, pre, svg'));
    wrong.push(`overflow to ${root.scrollWidth} px: ${wide.slice(0, 3).map(e => e.outerHTML.slice(0, 80))}`);
  }
  for (const i of document.images) if (!i.complete || !i.naturalWidth) wrong.push(`picture ${i.alt}`);
  for (const svg of document.querySelectorAll('svg')) {
    const box = svg.getBoundingClientRect();
    for (const t of svg.querySelectorAll('text')) {
      const r = t.getBoundingClientRect();
      if (r.left < box.left - 1 || r.right > box.right + 1 || r.top < box.top - 1 || r.bottom > box.bottom + 1)
        wrong.push(`"${t.textContent}" leaves its drawing`);
    }
  }
  const level = colour => {
    const [r, g, b] = colour.match(/[\\d.]+/g).map(v => v / 255).map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const style = getComputedStyle(document.body);
  const [a, b] = [level(style.color), level(style.backgroundColor)].sort((x, y) => y - x);
  if ((a + 0.05) / (b + 0.05) < 4.5) wrong.push(`contrast ${style.color} on ${style.backgroundColor}`);
  return wrong;
}"""


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
