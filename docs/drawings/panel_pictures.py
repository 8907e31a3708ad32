"""Makes docs/images/panel-*.png: the panel of three robots that move, wide and on a phone, light and dark.

    python docs/drawings/panel_pictures.py [ROBOT ...]

Each robot is run by contid itself on simulated devices, on a live stream that repeats one lap: a trajectory
of many laps would be checked as a whole first. A headless Chromium opens its panel and takes the image when
every robot follows its target and the plots have curves.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from PIL import Image

IMAGES: Final = Path(__file__).parents[1] / "images"
#: Arguments of `contid path` for what each robot does. Fingers that meet on a live stream hold at their
#: margin whenever the machine is late, so theirs stay 4 mm apart.
PATHS: Final[dict[str, tuple[str, ...]]] = {
    "hand": (
        "circle --center 48,70 --radius 20 --period 8 --robots left",
        "circle --center 52,70 --radius 20 --period 8 --robots right",
    ),
    "stiffflop2": ("circle --radius 25 --height 95 --period 5",),
    "chain": ("swing --period 5",),
}
#: Names behind ``panel-ROBOT``: viewport, and the scheme of colors.
VIEWS: Final[dict[str, dict[str, Any]]] = {
    "": {"viewport": {"width": 1280, "height": 1100}, "color_scheme": "light"},
    "-dark": {"viewport": {"width": 1280, "height": 1100}, "color_scheme": "dark"},
    "-phone": {"viewport": {"width": 390, "height": 844}, "color_scheme": "light"},
    "-phone-dark": {"viewport": {"width": 390, "height": 844}, "color_scheme": "dark"},
}
FLAGS: Final = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
#: The page has data, and a robot moves.
LIVE: Final = "body:has(#link[data-state=live]) .robot[data-state=RUN]"
#: Trail and plots have something to show then.
MOVING_S: Final = 14.0
#: Rows per second of the live stream; with fewer of them a late one matters less.
ROWS_PER_S: Final = 10.0
TIMEOUT_MS: Final = 300_000
#: Colors of a palette by frequency, and further ones for thin curves, which it would mix.
FREQUENT, RARE = 192, 64


def contid(*arguments: str, **keys: Any) -> subprocess.Popen[str]:
    """A command of contid."""
    return subprocess.Popen([sys.executable, "-m", "contid", *arguments], text=True, **keys)


def lap_of(robot: str) -> list[str]:
    """A header and the rows of one lap without times: a live stream."""
    columns: list[list[str]] = []
    for path in PATHS[robot]:
        options = ("--rate", f"{ROWS_PER_S:g}", "--for", robot)
        text = contid("path", *path.split(), *options, stdout=subprocess.PIPE).communicate()[0]
        columns.append([line.partition(",")[2] for line in text.splitlines()])
    return [",".join(parts) for parts in zip(*columns, strict=True)]


def feed(process: subprocess.Popen[str], lap: list[str]) -> None:
    """Write the rows of a lap again and again at the pace of time, until their reader ends."""
    assert process.stdin is not None
    with suppress(BrokenPipeError):
        process.stdin.write(f"{lap[0]}\n")
        rows = lap[2:]  # the first row is the last
        while True:
            process.stdin.write(f"{rows[int(time.monotonic() * ROWS_PER_S) % len(rows)]}\n")
            process.stdin.flush()
            time.sleep(1.0 / ROWS_PER_S)


def reduced(image: Image.Image) -> Image.Image:
    """An image with 256 colors."""
    frequent, rare = image.quantize(FREQUENT), image.quantize(RARE, Image.Quantize.MAXCOVERAGE)
    palette = Image.new("P", (1, 1))
    palette.putpalette(frequent.getpalette()[: 3 * FREQUENT] + rare.getpalette()[: 3 * RARE])
    return image.quantize(palette=palette, dither=Image.Dither.NONE)


def pictures(browser: Any, robot: str, folder: Path) -> None:
    """All pictures of one robot."""
    rows = lap_of(robot)
    running = contid("run", robot, "--mock", "-q", "--socket", str(folder / "s"), stdin=subprocess.PIPE)
    threading.Thread(target=feed, args=(running, rows), daemon=True).start()
    served = None
    try:
        while not (folder / "s").exists():
            time.sleep(0.1)
        panel = ("panel", "--socket", str(folder / "s"), "--port", "0")
        served = contid(*panel, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        assert served.stdout is not None
        url = served.stdout.readline().strip()
        for name, view in VIEWS.items():
            context = browser.new_context(**view)
            page = context.new_page()
            page.set_default_timeout(TIMEOUT_MS)
            page.goto(url)
            image = None
            while image is None:
                page.wait_for_selector(LIVE)
                page.wait_for_timeout(1e3 * MOVING_S)
                taken = page.screenshot()
                if page.locator(LIVE).count():  # a busy machine loses the connection now and then
                    image = Image.open(io.BytesIO(taken)).convert("RGB")
            context.close()
            target = IMAGES / f"panel-{robot}{name}.png"
            reduced(image).save(target, optimize=True)
            sys.stdout.write(f"{target}: {target.stat().st_size / 1e3:.0f} kB\n")
    finally:
        for process in filter(None, (served, running)):
            process.terminate()
            process.wait()


def main() -> None:
    """Make the pictures of the robots that were named, or of all."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        executable = os.environ.get("CONTID_CHROMIUM", "/usr/bin/chromium")
        browser = playwright.chromium.launch(executable_path=executable, args=list(FLAGS), timeout=TIMEOUT_MS)
        for robot in sys.argv[1:] or PATHS:
            with tempfile.TemporaryDirectory(prefix="contid-") as folder:
                pictures(browser, robot, Path(folder))
        browser.close()


if __name__ == "__main__":
    main()
