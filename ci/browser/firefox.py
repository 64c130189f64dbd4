"""camrig's pages in Firefox, which speaks WebDriver BiDi itself: python3 firefox.py FIREFOX FOLDER CAMRIG PAGE...

Reports: the checks of pages.py on a phone and a desk. The console of a rig: it comes alive, its plots are drawn, its
sliders drive the rig, an error is a banner, and no script complains.
"""

import base64
import contextlib
import json
import pathlib
import subprocess
import sys
import tempfile
import time
from websockets.sync.client import connect
from pages import CHECKS, of_console


class Firefox:
    """One tab of a headless Firefox with a profile of its own."""

    def __init__(self, program, profile):
        command = [program, "--headless", "--no-remote", "--profile", profile, "--remote-debugging-port", "0", "about:blank"]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        for line in self.process.stderr:
            if "WebDriver BiDi listening on " in line:
                address = line.split("listening on ")[1].strip()
                break
        else:
            raise RuntimeError("Firefox does not start")
        self.open_things = contextlib.ExitStack()
        self.socket = self.open_things.enter_context(connect(f"{address}/session", max_size=None))
        self.number, self.said = 0, []
        self.call("session.new", capabilities={})
        self.call("session.subscribe", events=["log.entryAdded"])
        self.tab = self.call("browsingContext.getTree")["contexts"][0]["context"]

    def call(self, method, **parameters):
        self.number += 1
        self.socket.send(json.dumps({"id": self.number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self.socket.recv(timeout=60))
            if answer.get("method") == "log.entryAdded":
                self.said.append(answer["params"]["text"])
            elif answer.get("id") == self.number:
                if answer["type"] == "error":
                    raise RuntimeError(f"{method}: {answer['message']}")
                return answer["result"]

    def size(self, width, height):
        self.call("browsingContext.setViewport", context=self.tab, viewport={"width": width, "height": height})

    def open(self, url):
        self.said.clear()
        self.call("browsingContext.navigate", context=self.tab, url=url, wait="complete")

    def ask(self, expression):
        """The value of a JavaScript expression, through JSON."""
        answer = self.call("script.evaluate", expression=f"JSON.stringify({expression})", awaitPromise=True,
                           target={"context": self.tab})
        if answer["type"] != "success":
            raise RuntimeError(answer["exceptionDetails"]["text"])
        return json.loads(answer["result"].get("value", "null"))

    def until(self, expression):
        end = time.monotonic() + 60
        while not self.ask(expression):
            if time.monotonic() > end:
                raise TimeoutError(expression)
            time.sleep(0.1)

    def picture(self, path):
        shot = self.call("browsingContext.captureScreenshot", context=self.tab, origin="document")
        pathlib.Path(path).write_bytes(base64.b64decode(shot["data"]))

    def close(self):
        self.open_things.close()
        self.process.kill()
        self.process.wait()


def live(firefox, folder, camrig):
    command = [camrig, "rig", "view", "emulator:", "--camera", "mt9v024", "--scene", "colorchecker", "--set", "sensor.width=188",
               "--set", "sensor.height=120", "--fps", "20"]
    rig = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    wrong = []
    try:
        firefox.size(1280, 844)
        firefox.open(rig.stdout.readline().strip())
        firefox.until("!!picture.frame && state.frames > 10 && noise.frames > 2")
        for plot in ["histogram", "profile", "time"]:
            pixels = f"document.querySelector('#{plot} canvas').getContext('2d').getImageData(0, 0, 300, 150).data"
            if not firefox.ask(f"new Uint32Array({pixels}.buffer).some(v => v)"):
                wrong.append(f"{plot} is empty")
        for slider, value, shown in [("exposure", -2.5, "3.16"), ("gain", 2, "× 4.00")]:
            firefox.ask(f"(e => {{ e.value = {value}; e.dispatchEvent(new Event('input')); }})(document.getElementById('{slider}'))")
            firefox.until(f"document.getElementById('{slider}-now').textContent.startsWith('{shown}')")
        firefox.ask("send({ set: { register: { address: 0x0666, value: 1 } } })")
        firefox.until("document.querySelectorAll('[role=alert]').length === 1")
        frames = firefox.ask("state.frames")
        firefox.until(f"picture.frame.number > {frames} + 5")
        wrong += of_console(firefox.ask(f"({CHECKS})()"))
        firefox.picture(f"{folder}/firefox-view.png")
        wrong += [f"console: {text}" for text in firefox.said]
    finally:
        rig.kill()
    return wrong


def main(program, folder, camrig, pages):
    wrong = []
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        firefox = Firefox(program, profile)
        try:
            for page in map(pathlib.Path, pages):
                for width in [390, 1280]:
                    firefox.size(width, 844)
                    firefox.open(page.resolve().as_uri())
                    found = firefox.ask(f"({CHECKS})()") + [f"console: {text}" for text in firefox.said]
                    wrong += [f"{page.name} at {width} px: {what}" for what in found]
                    firefox.picture(f"{folder}/firefox-{page.parent.name}-{page.stem}-{width}.png")
            wrong += [f"console: {what}" for what in live(firefox, folder, camrig)]
        finally:
            firefox.close()
    for line in wrong:
        print("FAILED in Firefox:", line)
    print(f"Firefox: {len(pages)} pages and the console looked at, {len(wrong)} complaints")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2], sys.argv[3], sys.argv[4:]))
