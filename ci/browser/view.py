"""The console of a rig in Chromium, with a rig that is unplugged, and a hostile page that tries to drive it:
python3 view.py CHROMIUM FOLDER CAMRIG"""

import base64
import contextlib
import http.server
import json
import os
import pathlib
import struct
import subprocess
import sys
import tempfile
import threading
import time
import urllib.parse
from playwright.sync_api import sync_playwright
from pages import CHECKS, of_console

SMALL = ["--set", "sensor.width=188", "--set", "sensor.height=120"]
QUAD = ["--set", "sensor.cfa=RRGG/RRGG/GGBB/GGBB"]
LOOK = ["--camera", "mt9v024", "--scene", "colorchecker"]
HOSTILE = """<!doctype html><title>hostile</title><script>
window.done = (async () => {
  const host = "%s", token = "%s", said = {};
  for (const [name, words] of Object.entries({ socket: ["camrig"], "socket with the token": ["camrig", token] })) {
    said[name] = await new Promise(done => {
      const socket = new WebSocket(`ws://${host}/socket`, words);
      socket.onopen = () => { socket.send('{"set":{"exposure_s":0.05}}'); done("open"); };
      socket.onerror = () => done("refused");
    });
  }
  for (const [name, what] of Object.entries({ page: {}, "no-cors": { mode: "no-cors" }, post: { method: "POST", body: "{}" } })) {
    try { const r = await fetch(`http://${host}/`, what); said[name] = r.type === "opaque" ? "opaque" : r.status; }
    catch (e) { said[name] = "refused"; }
  }
  const frame = document.createElement("iframe");
  frame.src = `http://${host}/#${token}`;
  document.documentElement.append(frame);
  await new Promise(done => { frame.onload = done; setTimeout(done, 2000); });
  try { said.frame = frame.contentDocument ? "readable" : "closed"; } catch (e) { said.frame = "closed"; }
  return said;
})();
</script>"""
ALLOWED = {"socket": "refused", "socket with the token": "refused", "page": "refused", "no-cors": "refused", "post": "refused",
           "frame": "closed"}


class Hostile(http.server.BaseHTTPRequestHandler):
    page = b""

    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(self.page)

    def log_message(self, *_):
        pass


@contextlib.contextmanager
def running(command, **more):
    """A program that prints its address, until the end of the block."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, **more)
    try:
        yield process, process.stdout.readline().strip()
    finally:
        process.kill()
        process.wait()


class Console:
    """The console in a browser's tab, and what it complains of."""

    def __init__(self, browser, url, width=1280, height=900):
        self.view = browser.new_page(viewport={"width": width, "height": height})
        self.wrong = []
        self.view.on("console", lambda m: self.wrong.append(f"console: {m.text}"))
        self.view.on("pageerror", lambda e: self.wrong.append(f"error: {e}"))
        own = urllib.parse.urlsplit(url).netloc
        self.view.on("request", lambda r: None if urllib.parse.urlsplit(r.url).netloc in ("", own) else
                     self.wrong.append(f"network: {r.url}"))
        self.view.goto(url)

    def ask(self, expression, argument=None):
        return self.view.evaluate(expression, argument)

    def text(self, selector):
        return self.ask("s => document.querySelector(s).textContent", selector)

    def until(self, expression, seconds=60):
        """Waits for the page. Playwright's own wait evaluates text in the page, which its policy forbids."""
        end = time.monotonic() + seconds
        while not self.ask(expression):
            if time.monotonic() > end:
                raise TimeoutError(f"{expression}; status: {self.text('#status')}, banners: {self.text('#banners')}")
            self.view.wait_for_timeout(50)

    def goes_on(self):
        now = self.ask("state.frames")
        self.until(f"state.frames > {now} + 3 && picture.frame.number > {now}")

    def slide(self, slider, value):
        self.ask("""([id, value]) => { const e = document.getElementById(id); e.value = value; e.dispatchEvent(new Event('input')); }""",
                 [slider, value])

    def check(self, holds, what):
        if not holds:
            self.wrong.append(what)

    def mean(self):
        """Mean above black of the first channel, DN, in the table."""
        return float(self.text("#channels tbody td").replace("−", "-"))


def dng_samples(camrig, path):
    """Size and samples of a DNG, by way of NPY."""
    with tempfile.TemporaryDirectory() as folder:
        target = pathlib.Path(folder) / "x.npy"
        subprocess.run([camrig, "convert", path, target], check=True, capture_output=True)
        data = target.read_bytes()
    length = struct.unpack_from("<H", data, 8)[0]
    shape = eval(data[10:10 + length].decode(), {"False": False, "True": True})["shape"]
    height, width = shape[-2:]
    return width, height, struct.unpack_from(f"<{width * height}H", data, 10 + length)


def frames_and_readout(console, camrig, folder):
    """Frames arrive; what is read out is what is saved."""
    console.until("picture.frame && state.frames > 5")
    console.ask("document.getElementById('freeze').click()")
    console.until("document.getElementById('status').textContent.startsWith('frozen')")
    box = console.view.locator("#stage").bounding_box()
    console.view.mouse.move(box["x"] + box["width"] * 0.4, box["y"] + box["height"] * 0.6)
    words = console.text("#pixel").split()
    x, y, dn = int(words[1]), int(words[4]), int(words[7])
    before = console.ask("events.newest")
    console.ask("document.getElementById('save').click()")
    console.until(f"events.newest > {before}")
    path = pathlib.Path(console.ask("events.lines.at(-1).text").split(": ")[1])
    width, height, samples = dng_samples(camrig, folder / path)
    console.check(samples[y * width + x] == dn, f"read out {words}, saved {samples[y * width + x]}")
    same = console.ask("v => v.length === picture.frame.samples.length && v.every((dn, i) => dn === picture.frame.samples[i])", list(samples))
    console.check(same, "the saved frame is not the one that is shown")
    number = console.ask("picture.frame.number")
    console.ask("document.getElementById('save').click()")
    console.until(f"events.newest > {before + 1}")
    console.check(len(list(folder.glob(f"*{number:06}*.dng"))) == 2, "a second file of one frame")
    console.check(console.ask("picture.frame.number") == number, "a frozen page shows another frame")
    console.ask("document.getElementById('freeze').click()")
    console.goes_on()


def developed(console, camrig, folder):
    """The picture as captured is the one that camrig develops from the saved frame, to one level of 8 bits.

    At this exposure a hundredth of the frame is white, so that `convert --preview` brightens nothing either.
    """
    console.slide("exposure", -0.8)
    console.until("Math.abs(picture.frame.exposure_s - 10 ** -0.8) < 1e-4")
    console.ask("document.getElementById('freeze').click()")
    console.until("document.getElementById('status').textContent.startsWith('frozen')")
    before = console.ask("events.newest")
    console.ask("document.getElementById('save').click()")
    console.until(f"events.newest > {before}")
    path = folder / console.ask("events.lines.at(-1).text").split(": ")[1]
    png = path.with_suffix(".png")
    subprocess.run([camrig, "convert", path, png, "--preview"], check=True, capture_output=True)
    found = console.ask("""async url => {
        const image = new Image(), frame = picture.frame;
        image.src = url;
        await image.decode();
        const canvas = element("canvas", { width: frame.width, height: frame.height }), g = canvas.getContext("2d");
        g.drawImage(image, 0, 0);
        const theirs = g.getImageData(0, 0, frame.width, frame.height).data;
        const own = new Uint32Array(frame.width * frame.height);
        const difference = () => new Uint8Array(own.buffer).reduce((most, v, i) => Math.max(most, Math.abs(v - theirs[i])), 0);
        developFine(frame, wholeFrame(frame), 1, false, own);
        const bayer = difference();
        developFine({ ...frame, bayer: false }, wholeFrame(frame), 1, false, own);
        return [image.naturalWidth === frame.width, bayer, difference()];
    }""", "data:image/png;base64," + base64.b64encode(png.read_bytes()).decode())
    console.check(found[0] and max(found[1:]) <= 1, f"developed: {found}")
    console.ask("document.getElementById('freeze').click()")
    console.goes_on()


def controls(console):
    """Exposure and light scale the mean; automatic exposure reaches its goal."""
    console.slide("exposure", -2)
    console.until("Math.abs(picture.frame.exposure_s - 0.01) < 1e-5")
    console.view.wait_for_timeout(300)
    full = console.mean()
    console.slide("exposure", -2.30103)
    console.until("Math.abs(picture.frame.exposure_s - 0.005) < 1e-5")
    console.view.wait_for_timeout(300)
    console.check(abs(console.mean() / full - 0.5) < 0.02, f"half the exposure: {console.mean()} of {full} DN")
    console.slide("lux", 2.78)
    console.until("state.settings.lux > 600 && picture.frame.light.includes(String(state.settings.lux))")
    console.view.wait_for_timeout(300)
    console.check(abs(console.mean() / full - 1) < 0.02, f"half the exposure, twice the light: {console.mean()} of {full} DN")
    console.ask("document.getElementById('auto').click()")
    console.until("state.settings.auto_exposure && Math.abs(state.settings.exposure_s - 0.005) > 1e-4")
    # By the brightest channel: each place of the 2 x 2 pattern has its own 99 %.
    console.until("""(() => { const f = picture.frame, at = [[], [], [], []];
        f.samples.forEach((dn, i) => at[(i % f.width) % 2 + 2 * (Math.floor(i / f.width) % 2)].push(dn));
        const v = Math.max(...at.map(of => of.sort((a, b) => a - b)[Math.floor(0.99 * of.length)]));
        return Math.abs((v - picture.frame.black) / (picture.frame.white_level_dn - picture.frame.black) - 0.85) < 0.1; })()""")
    # The box follows the state with the next picture of the page: a click before that would tick it once more.
    console.until("document.getElementById('auto').checked")
    console.ask("document.getElementById('auto').click()")
    console.until("!state.settings.auto_exposure")
    console.view.select_option("#illuminant", "A")
    console.until("state.settings.illuminant === 'A' && picture.frame.light.includes(' in A at')", 120)
    console.goes_on()


def faults(console):
    """A bad register and a bad number are banners until they are dismissed; the stream goes on."""
    console.ask("document.getElementById('registers').open = true")
    console.until("document.querySelectorAll('#registers tbody tr').length > 10")
    for address, value, word in [("0x0666", "1", "0x0666"), ("0x0202", "x", "numbers")]:
        console.view.fill("#other-address", address)
        console.view.fill("#other-value", value)
        console.view.press("#other-value", "Enter")
        console.until(f"[...document.querySelectorAll('[role=alert]')].some(e => e.textContent.includes('{word}'))")
        console.goes_on()
    console.ask("document.querySelectorAll('[role=alert] button').forEach(b => b.click())")
    console.check(console.ask("document.querySelectorAll('[role=alert]').length") == 0, "a banner stays that was dismissed")
    console.view.fill("#other-address", "0x3100")
    console.view.fill("#other-value", "1")
    console.view.press("#other-value", "Enter")
    console.until("state.dropped > 0")
    console.goes_on()


def recording(console, camrig, folder):
    """A recording has the frames that it says."""
    console.ask("document.getElementById('record').click()")
    console.until("state.recording && state.recording.frames > 5")
    console.ask("document.getElementById('record').click()")
    console.until("!state.recording && events.lines.some(e => e.text.includes(' recorded: '))")
    words = console.ask("events.lines.findLast(e => e.text.includes(' recorded: ')).text")
    path = folder / words.split(": ")[1]
    with tempfile.TemporaryDirectory() as other:
        done = subprocess.run([camrig, "convert", path, pathlib.Path(other) / "x.npy"], capture_output=True, text=True)
        head = (pathlib.Path(other) / "x.npy").read_bytes()[:128].decode(errors="replace") if done.returncode == 0 else done.stderr
    console.check(f"({words.split()[0]}, 120, 188)" in head, f"{words}, but: {head}")


def parts(console):
    """Zoom, region, views and plots."""
    for plot in ["histogram", "profile", "time"]:
        drawn = f"new Uint32Array(document.querySelector('#{plot} canvas').getContext('2d').getImageData(0, 0, 300, 150).data.buffer).some(v => v)"
        console.check(console.ask(drawn), f"{plot} is empty")
    console.ask("document.getElementById('region').click()")
    box = console.view.locator("#stage").bounding_box()
    console.view.mouse.move(box["x"] + box["width"] * 0.45, box["y"] + box["height"] * 0.45)
    console.view.mouse.down()
    console.view.mouse.move(box["x"] + box["width"] * 0.55, box["y"] + box["height"] * 0.55)
    console.view.mouse.up()
    console.until("document.querySelectorAll('#region-figures tbody tr').length === picture.frame.channels.length")
    figures = console.ask("""() => { const f = picture.frame, r = picture.region, of = [];
        for (let y = r.y; y < r.y + r.height; y++) for (let x = r.x; x < r.x + r.width; x++) if (f.channelAt(x, y) === 0) of.push(f.at(x, y));
        const mean = of.reduce((a, b) => a + b) / of.length, s = statistics(f, r)[0];
        return [mean, Math.sqrt(of.reduce((a, b) => a + (b - mean) ** 2, 0) / (of.length - 1)), s.mean, s.deviation]; }""")
    console.check(abs(figures[0] - figures[2]) < 1e-9 and abs(figures[1] - figures[3]) < 1e-6, f"region: {figures}")
    console.ask("document.getElementById('region').click()")
    for value in ["noise", "captured", "preview"]:
        console.ask(f"document.querySelector('[data-value={value}]').click()")
        console.goes_on()
    for value in ["8", "3", "1", "fit"]:
        console.ask(f"document.querySelector('[data-value=\"{value}\"]').click()")
        console.goes_on()
    console.view.focus("#stage")
    before = console.ask("({...picture.cursor})")
    console.view.keyboard.press("ArrowRight")
    console.check(console.ask("picture.cursor.x") == before["x"] + 1, "the arrow keys step over samples")


def looks(browser, url, folder):
    """The page on a desk and a phone, dark and light."""
    wrong = []
    for width, height in [(1280, 900), (390, 844)]:
        console = Console(browser, url, width, height)
        console.until("picture.frame && state.frames > 5")
        for scheme in ["dark", "light"]:
            console.check(console.ask("document.documentElement.classList.contains('dark')") == (scheme == "dark"), f"not {scheme}")
            console.view.wait_for_timeout(500)
            console.wrong += of_console(console.ask(f"({CHECKS})()"))
            console.view.screenshot(path=f"{folder}/view-{width}-{scheme}.png", full_page=True)
            console.ask("document.getElementById('theme').click()")
        console.view.close()
        wrong += [f"{width} px: {what}" for what in console.wrong]
    return wrong


def unplugged(browser, camrig):
    """A rig that goes and comes back: the page says so, and streams again."""
    serve = [camrig, "rig", "serve", "--tcp"]
    with contextlib.ExitStack() as things:
        rig, address = things.enter_context(running(serve + ["127.0.0.1:0"]))
        _, url = things.enter_context(running([camrig, "rig", "view", address, *LOOK, *SMALL]))
        console = Console(browser, url)
        console.until("picture.frame && state.frames > 5")
        rig.kill()
        rig.wait()
        console.until("document.getElementById('status').textContent.startsWith('reconnecting')")
        console.until("document.querySelectorAll('[role=alert]').length > 0")
        things.enter_context(running(serve + [address.removeprefix("tcp://")]))
        console.until("document.getElementById('status').textContent === 'streaming'")
        console.goes_on()
        console.view.close()
        return [f"unplugged: {what}" for what in console.wrong]


def waiting(browser, camrig):
    """A scene that is still to come: the page says so, and shows it when it comes. What holds for all its frames is one
    line of the log, which counts."""
    video = [camrig, "rig", "view", "emulator:", "--camera", "mt9v024", *SMALL, "--scene", "-", "--stall", "100", "--lux", "300"]
    with running(video, stdin=subprocess.PIPE) as (rig, url):
        console = Console(browser, url)
        console.until("document.getElementById('status').textContent === 'waiting for the first frame of standard input'")
        frames = [b"FRAME\n" + bytes([60 + 20 * k]) * 64 + bytes([128]) * 128 for k in range(5)]
        rig.stdin.buffer.write(b"YUV4MPEG2 W8 H8 F25:1 Ip A1:1 C444\n" + b"".join(frames))
        rig.stdin.buffer.flush()
        console.until("picture.frame && document.getElementById('status').textContent === 'streaming'")
        console.until("state.scene.frames.used === 5")
        console.view.wait_for_timeout(500)
        lines = console.ask("[...document.querySelectorAll('#log pre span')].map(e => e.textContent)")
        of_all = [line for line in lines if "sRGB is assumed" in line]
        console.check(len(of_all) == 1 and of_all[0].endswith("(5 times)"), f"the log has {lines}")
        console.view.close()
        return [f"a scene to come: {what}" for what in console.wrong]


def processor_seconds(pid):
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def tree(pid):
    """A process and those that it has started."""
    children = pathlib.Path(f"/proc/{pid}/task/{pid}/children")
    found = [pid]
    for child in children.read_text().split() if children.exists() else []:
        found += tree(int(child))
    return found


@contextlib.contextmanager
def untapped(chromium, url):
    """A page in a Chromium of its own that nobody listens to: Playwright is told every message of a socket, which takes
    as long as the page itself. Gives the process, and the port on which Playwright can be let in afterwards."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        process = subprocess.Popen([chromium, "--headless", "--no-sandbox", "--window-size=1280,900", "--remote-debugging-port=0",
                                    f"--user-data-dir={profile}", url], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            told, end = pathlib.Path(profile) / "DevToolsActivePort", time.monotonic() + 60
            while not (told.exists() and told.read_text().strip()):
                if time.monotonic() > end:
                    raise TimeoutError("Chromium does not start")
                time.sleep(0.05)
            yield process, told.read_text().split()[0]
        finally:
            process.terminate()
            process.wait(timeout=60)


def speed(playwright, chromium, camrig):
    """Frames per second at 752 x 480, and processor time per frame: told, as machines differ."""
    with running([camrig, "rig", "view", "emulator:", *LOOK]) as (rig, url), untapped(chromium, url) as (own, port):
        time.sleep(3)
        spent = lambda: [processor_seconds(rig.pid), sum(processor_seconds(pid) for pid in tree(own.pid))]
        before, begin = spent(), time.monotonic()
        time.sleep(6)
        seconds = time.monotonic() - begin
        of_camrig, of_browser = [(b - a) / seconds for a, b in zip(before, spent())]
        browser = playwright.chromium.connect_over_cdp(f"http://127.0.0.1:{port}")
        texts = "['rate', 'shown', 'late'].map(id => document.getElementById(id).textContent)"
        rate, shown, late = browser.contexts[0].pages[0].evaluate(texts)
        rate, shown = float(rate.split()[0]), float(shown.split()[0])
        print(f"752 x 480: {rate} frames/s of the rig, {shown} shown, {late} late; processor time per frame: "
              f"camrig {1e3 * of_camrig / rate:.1f} ms, browser {1e3 * of_browser / shown:.1f} ms")
        browser.close()
        return [] if shown > 1 else ["the page does not keep up at all"]


def hostile(browser, url):
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Hostile)
    try:
        parts_ = urllib.parse.urlsplit(url)
        # Even one that has found out the token is another origin.
        Hostile.page = (HOSTILE % (parts_.netloc, parts_.fragment)).encode()
        threading.Thread(target=server.serve_forever, daemon=True).start()
        own = Console(browser, url)
        own.until("picture.frame && state.frames > 5")
        before = own.ask("state.settings.exposure_s")
        page = browser.new_page()
        page.goto(f"http://127.0.0.1:{server.server_port}/")
        said = page.evaluate("window.done")
        print("a hostile page:", json.dumps(said))
        own.check(said == ALLOWED, f"a hostile page got {said}")
        own.goes_on()
        own.check(own.ask("state.settings.exposure_s") == before, "a hostile page drove the exposure")
        page.close()
        own.view.close()
        return own.wrong
    finally:
        server.shutdown()


def main(chromium, folder, camrig):
    camrig = str(pathlib.Path(camrig).resolve())
    with tempfile.TemporaryDirectory() as work, sync_playwright() as playwright:
        work = pathlib.Path(work)
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        with running([camrig, "rig", "view", "emulator:", *LOOK, *SMALL], cwd=work) as (_, url):
            console = Console(browser, url)
            frames_and_readout(console, camrig, work)
            developed(console, camrig, work)
            controls(console)
            parts(console)
            faults(console)
            recording(console, camrig, work)
            console.view.screenshot(path=f"{folder}/view-used.png", full_page=True)
            console.view.close()
            wrong = console.wrong + hostile(browser, url)
        with running([camrig, "rig", "view", "emulator:", *LOOK, *SMALL, *QUAD], cwd=work) as (_, url):
            console = Console(browser, url)
            console.until("picture.frame && state.frames > 5")
            developed(console, camrig, work)
            console.view.close()
            wrong += console.wrong
        with running([camrig, "rig", "view", "emulator:", *LOOK, "--exposure", "30ms"]) as (_, url):
            wrong += looks(browser, url, folder)
        wrong += unplugged(browser, camrig)
        wrong += waiting(browser, camrig)
        browser.close()
        wrong += speed(playwright, chromium, camrig)
    for line in wrong:
        print("FAILED:", line)
    print(f"the console in Chromium: {len(wrong)} complaints")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
