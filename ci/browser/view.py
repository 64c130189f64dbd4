"""The live page of a rig in Chromium, and a hostile page that tries to drive it: python3 view.py CHROMIUM FOLDER CAMRIG"""

import http.server
import json
import subprocess
import sys
import threading
import time
import urllib.parse
from playwright.sync_api import sync_playwright

HOSTILE = """<!doctype html><title>hostile</title><script>
window.done = (async () => {
  const target = "http://%s", said = {};
  const attempt = async (name, what) => {
    try { const r = await fetch(target + "/api/control", what); said[name] = r.type === "opaque" ? "opaque" : r.status; }
    catch (e) { said[name] = "refused"; }
  };
  const body = JSON.stringify({ exposure_s: 0.05 });
  await attempt("plain", { method: "POST", body });
  await attempt("no-cors", { method: "POST", mode: "no-cors", body });
  await attempt("token header", { method: "POST", body, headers: { "X-Camrig-Token": "%s" } });
  await attempt("credentials", { method: "POST", body, credentials: "include" });
  said.picture = await new Promise(done => {
    const image = new Image();
    image.onload = () => done("shown");
    image.onerror = () => done("refused");
    image.src = target + "/api/frame.png";
  });
  return said;
})();
</script>"""


class Hostile(http.server.BaseHTTPRequestHandler):
    page = b""

    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(self.page)

    def log_message(self, *_):
        pass


def until(view, expression):
    """Waits for the page. Playwright's own wait evaluates text in the page, which its policy forbids."""
    end = time.monotonic() + 60
    while not view.evaluate(expression):
        if time.monotonic() > end:
            raise TimeoutError(expression)
        view.wait_for_timeout(100)


def look(browser, url, width, scheme, folder):
    view = browser.new_page(viewport={"width": width, "height": 844}, color_scheme=scheme)
    wrong = []
    # Chromium tells of answers like 404 (no noise map before two frames) as a console error.
    view.on("console", lambda m: None if "404" in m.text else wrong.append(f"console: {m.text}"))
    view.on("pageerror", lambda e: wrong.append(f"error: {e}"))
    view.goto(url)
    until(view, "document.getElementById('told').textContent.includes('frames/s')")
    until(view, "document.getElementById('noise').naturalWidth > 0")
    if view.evaluate("document.documentElement.scrollWidth > window.innerWidth"):
        wrong.append("overflow to the side")
    ink = "id => new Uint32Array(document.getElementById(id).getContext('2d').getImageData(0, 0, 640, 160).data.buffer).some(v => v)"
    for canvas in ["histogram", "row-profile", "column-profile"]:
        if not view.evaluate(ink, canvas):
            wrong.append(f"{canvas} is empty")
    view.evaluate("""() => { const e = document.getElementById('exposure'); e.value = -2.5; e.dispatchEvent(new Event('change')); }""")
    until(view, "document.getElementById('exposure-now').textContent.startsWith('3.16')")
    view.evaluate("""() => { const e = document.getElementById('gain'); e.value = 2; e.dispatchEvent(new Event('change')); }""")
    until(view, "document.getElementById('gain-now').textContent.startsWith('4.00')")
    view.screenshot(path=f"{folder}/view-{width}-{scheme}.png", full_page=True)
    view.evaluate("""() => { const e = document.getElementById('exposure'); e.value = -2; e.dispatchEvent(new Event('change')); }""")
    until(view, "document.getElementById('exposure-now').textContent.startsWith('10.00')")
    view.close()
    return [f"{width} px, {scheme}: {what}" for what in wrong]


def main(chromium, folder, camrig):
    command = [camrig, "rig", "view", "emulator:", "--camera", "mt9v024", "--scene", "colorchecker", "--set", "sensor.width=188",
               "--set", "sensor.height=120", "--fps", "20"]
    rig = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Hostile)
    try:
        url = rig.stdout.readline().strip()
        parts = urllib.parse.urlsplit(url)
        # Even one that has found out the token is another origin.
        Hostile.page = (HOSTILE % (parts.netloc, parts.fragment)).encode()
        threading.Thread(target=server.serve_forever, daemon=True).start()
        wrong = []
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
            for width, scheme in [(1280, "light"), (390, "dark")]:
                wrong += look(browser, url, width, scheme, folder)
            page = browser.new_page()
            page.goto(f"http://127.0.0.1:{server.server_port}/")
            said = page.evaluate("window.done")
            print("a hostile page:", json.dumps(said))
            allowed = {"plain": "refused", "no-cors": "refused", "token header": "refused", "credentials": "refused",
                       "picture": "refused"}
            if said != allowed:
                wrong.append(f"a hostile page got {said}")
            own = browser.new_page()
            own.goto(url)
            until(own, "document.getElementById('told').textContent.includes('frames/s')")
            now = own.evaluate("document.getElementById('exposure-now').textContent")
            if not now.startswith("10.00"):
                wrong.append(f"a hostile page drove the exposure to {now}")
            browser.close()
    finally:
        rig.kill()
        server.shutdown()
    for line in wrong:
        print("FAILED:", line)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
