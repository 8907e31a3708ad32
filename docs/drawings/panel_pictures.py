"""Makes docs/images/panel-*.png: the panel of three robots that move, wide and on a phone, light and dark.

    python docs/drawings/panel_pictures.py [ROBOT ...]

Each robot is run by contid itself on simulated devices, with a trajectory of many laps; a headless Chromium
opens its panel and takes the image when every robot follows its target.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

from PIL import Image

IMAGES: Final = Path(__file__).parents[1] / "images"
#: Arguments of `contid path` for what each robot does.
PATHS: Final = {
    "hand": ("circle", "--center", "50,70", "--radius", "20"),
    "stiffflop2": ("circle", "--radius", "25", "--height", "95", "--period", "5"),
    "chain": ("swing", "--period", "5"),
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
MOVING_S: Final = 8.0
TIMEOUT_MS: Final = 300_000
#: Colors of a palette by frequency, and further ones for thin curves, which it would mix.
FREQUENT, RARE = 192, 64


def contid(*arguments: str, **keys: Any) -> subprocess.Popen[str]:
    """A command of contid."""
    return subprocess.Popen(
        [sys.executable, "-m", "contid", *arguments], text=True, stdin=subprocess.DEVNULL, **keys
    )


def reduced(image: Image.Image) -> Image.Image:
    """An image with 256 colors."""
    frequent, rare = image.quantize(FREQUENT), image.quantize(RARE, Image.Quantize.MAXCOVERAGE)
    palette = Image.new("P", (1, 1))
    palette.putpalette(frequent.getpalette()[: 3 * FREQUENT] + rare.getpalette()[: 3 * RARE])
    return image.quantize(palette=palette, dither=Image.Dither.NONE)


def pictures(browser: Any, robot: str, folder: Path) -> None:
    """All pictures of one robot."""
    path = folder / "path.csv"
    with path.open("w") as file:
        contid("path", *PATHS[robot], "--laps", "200", "--for", robot, stdout=file).wait()
    running = contid("run", robot, "--mock", "-q", "--socket", str(folder / "s"), "--trajectory", str(path))
    served = None
    try:
        while not (folder / "s").exists():
            time.sleep(0.1)
        panel = ("panel", "--socket", str(folder / "s"), "--port", "0")
        served = contid(*panel, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
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
