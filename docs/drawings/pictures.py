"""Makes docs/images/*.png: real screenshots of the viewer's page in a headless Chromium.

    python docs/drawings/pictures.py [ROBOT ...]

Each robot is run by contid itself, on simulated devices, with ``--view FILE.rrd``; the file is served by
``contid view --serve`` and photographed when the page has drawn it. Needs Chromium (``apt-get install
chromium``); there is no network to wait for, the page's own policy forbids it.
"""

from __future__ import annotations

import base64
import io
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from PIL import Image

IMAGES = Path(__file__).parents[1] / "images"
SIZE = (1280, 720)
#: Software rendering draws a page of curves in some seconds; two equal screenshots in a row end the wait.
PAGE_TIMEOUT_S = 120.0
EVERY_S = 4.0
#: Where the page has the beginning and the end of the run, in pixels from the left, and how far down.
SLIDER = (268, 1072)
SLIDER_HEIGHT = SIZE[1] - 14

#: What each robot does in its image: arguments of `contid path`, and when in the run it is seen, 0 to 1.
PATHS = {
    "finger": ("circle --center 20,80 --radius 10 --period 3 --laps 3", 0.75),
    "hand": ("circle --center 50,70 --radius 20 --period 4 --laps 2", 0.75),
    "trirack": ("circle --size 300 --height 300 --period 5 --laps 2", 0.8),
    "trirack2": ("circle --size 160 --height 450 --lean 20 --period 5 --laps 2", 0.8),
    "cbha": ("circle --size 80 --height 230 --lean 15 --period 5 --laps 2", 0.62),
    "stiffflop1": ("spiral --radius 24 --height 55 --period 8", 0.7),
    "stiffflop2": ("circle --radius 25 --height 95 --period 5 --laps 2", 0.7),
    "chain": ("swing --period 5 --laps 2", 0.8),
}
#: The others are looked at when the camera or the layout changes.
ON_PAGES = ("finger", "hand", "trirack2", "cbha", "stiffflop2", "chain")


class Browser:
    """Chromium without a window, controlled over a pair of pipes."""

    def __init__(self, profile: Path) -> None:
        program = shutil.which("chromium") or shutil.which("google-chrome")
        if program is None:
            raise SystemExit("no chromium: apt-get install chromium")
        theirs_in, ours_out = os.pipe()
        ours_in, theirs_out = os.pipe()
        # The browser reads its descriptor 3 and writes its descriptor 4.
        command = [
            "sh", "-c", f'exec "$0" "$@" 3<&{theirs_in} 4>&{theirs_out}', program,
            "--headless", "--no-sandbox", "--remote-debugging-pipe", f"--user-data-dir={profile}",
            "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
            "--hide-scrollbars", f"--window-size={SIZE[0]},{SIZE[1]}", "--no-first-run",
            "--disable-background-networking", "about:blank",
        ]  # fmt: skip
        self._process = subprocess.Popen(
            command, pass_fds=[theirs_in, theirs_out], stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        os.close(theirs_in)
        os.close(theirs_out)
        self._in, self._out, self._left, self._number = ours_in, ours_out, b"", 0
        self._session: str | None = None
        #: Addresses outside this machine that the page asked for, and whether it got them.
        self.outside: dict[str, bool] = {}
        self._asked: dict[str, str] = {}
        target = self.call("Target.createTarget", url="about:blank")
        self._session = self.call("Target.attachToTarget", targetId=target["targetId"], flatten=True)[
            "sessionId"
        ]
        self.call("Network.enable")
        self.call("Page.enable")
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=SIZE[0], height=SIZE[1], deviceScaleFactor=1, mobile=False,
        )  # fmt: skip

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """A command of the DevTools protocol and its answer."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        deadline_s = time.monotonic() + PAGE_TIMEOUT_S
        while time.monotonic() < deadline_s:
            for answer in self._messages(1.0):
                if answer.get("id") == self._number:
                    if "error" in answer:
                        raise SystemExit(f"{method}: {answer['error']}")
                    return dict(answer["result"])
        raise SystemExit(f"{method}: no answer")

    def evaluate(self, expression: str) -> Any:
        """Value of a script expression in the page."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True)
        if "exceptionDetails" in answer:
            raise SystemExit(f"{expression}: {answer['exceptionDetails']['exception'].get('description')}")
        return answer["result"].get("value")

    def click(self, x: float, y: float) -> None:
        """Press the mouse there, then move it out of the image."""
        for kind, place in (("mouseMoved", (x, y)), ("mousePressed", (x, y)), ("mouseReleased", (x, y))):
            button = {"button": "left", "clickCount": 1} if kind != "mouseMoved" else {}
            self.call("Input.dispatchMouseEvent", type=kind, x=place[0], y=place[1], **button)
            self.wait(0.5)
        self.call("Input.dispatchMouseEvent", type="mouseMoved", x=640, y=SIZE[1] - 60)

    def press_space(self) -> None:
        """Press the space bar."""
        for kind, text in (("keyDown", " "), ("keyUp", "")):
            self.call("Input.dispatchKeyEvent", type=kind, key=" ", code="Space", text=text)
            self.wait(0.5)

    def wait(self, seconds: float) -> None:
        """Let the page work."""
        deadline_s = time.monotonic() + seconds
        while (rest := deadline_s - time.monotonic()) > 0:
            self._messages(rest)

    def screenshot(self) -> bytes:
        """The page as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def close(self) -> None:
        """End it."""
        self._session = None
        self.call("Browser.close")
        self._process.wait()
        os.close(self._in)
        os.close(self._out)

    def _messages(self, seconds: float) -> list[dict[str, Any]]:
        if not select.select([self._in], [], [], seconds)[0]:
            return []
        data = os.read(self._in, 1 << 20)
        if not data:
            raise SystemExit("the browser ended")
        *whole, self._left = (self._left + data).split(b"\0")
        messages = [json.loads(each) for each in whole]
        for message in messages:
            self._watch(message.get("method"), message.get("params", {}))
        return messages

    def _watch(self, method: str | None, parameters: dict[str, Any]) -> None:
        """Keep account of what goes out of the machine."""
        if method == "Network.requestWillBeSent":
            url = parameters["request"]["url"]
            if url.startswith("http") and urlsplit(url).hostname not in ("127.0.0.1", "localhost"):
                self.outside.setdefault(url, False)
                self._asked[parameters["requestId"]] = url
        elif method == "Network.responseReceived" and parameters["requestId"] in self._asked:
            self.outside[self._asked[parameters["requestId"]]] = True


def contid(*arguments: str, stdin: str | None = None) -> str:
    """Run contid; returns what it printed."""
    done = subprocess.run(
        [sys.executable, "-m", "contid", *arguments],
        input=stdin,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return done.stdout


@contextmanager
def served(path: Path) -> Iterator[str]:
    """The address of the page with a recording."""
    command = [sys.executable, "-m", "contid", "view", "--serve", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.terminate()


def image(robot: str, folder: Path) -> Path:
    """Run a robot and photograph it."""
    recording = folder / f"{robot}.rrd"
    path, share = PATHS[robot]
    trajectory = contid("path", *path.split(), "--for", robot)
    sys.stderr.write(contid("run", robot, "--virtual", "--view", str(recording), stdin=trajectory))
    with served(recording) as url:
        browser = Browser(folder / "profile")
        try:
            browser.call("Page.navigate", url=f"{url}&renderer=webgl")
            while not browser.evaluate("!!window._handle"):
                browser.wait(1.0)
            browser.wait(2 * EVERY_S)
            browser.press_space()  # it plays
            browser.wait(EVERY_S)
            browser.click(SLIDER[0] + share * (SLIDER[1] - SLIDER[0]), SLIDER_HEIGHT)
            browser.wait(EVERY_S)  # a panel that is gone takes no click
            for panel in ("top", "time"):
                browser.evaluate(f"_handle.override_panel_state('{panel}', 'hidden')")
            last, shot = b"", b""
            deadline_s = time.monotonic() + PAGE_TIMEOUT_S
            while (not shot or shot != last) and time.monotonic() < deadline_s:
                browser.wait(EVERY_S)
                last, shot = shot, browser.screenshot()
            for outside, answered in browser.outside.items():
                sys.stderr.write(f"asked for {outside}: {'ANSWERED' if answered else 'refused'}\n")
        finally:
            browser.close()
    target = IMAGES / f"{robot}.png"
    target.parent.mkdir(exist_ok=True)
    # Five bits a colour: the page is flat areas and thin lines, the difference is invisible.
    few = Image.open(io.BytesIO(shot)).convert("RGB").point(lambda value: min(value + 4, 255) & 0xF8)
    few.save(target, optimize=True)
    return target


def main() -> None:
    """Make the pictures that were asked for, or all that are on a page."""
    for robot in sys.argv[1:] or ON_PAGES:
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            path = image(robot, Path(folder))
        sys.stderr.write(f"{path}: {path.stat().st_size / 1e3:.0f} kB\n")


if __name__ == "__main__":
    main()
