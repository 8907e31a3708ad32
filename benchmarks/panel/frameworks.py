"""The panel beside NiceGUI: what a page loads, how long STOP takes, and what keeps other sites out.

``python -m benchmarks.panel.frameworks [--presses 60]``. Both pages have a STOP button and live plots of the
same daemon, `contid run hand --mock`, one after the other, in headless Chromium. ``--presses 0`` leaves STOP
out. NiceGUI's page is `benchmarks.panel.nicegui_page`: a button and one plot; the panel is whole. Lines of
code are not empty and no comments; those of the panel are of what STOP and plots need: server, connection,
button, plots.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import httpx
import psutil

import contid_panel
from benchmarks.on_sigterm import leave_on_sigterm
from benchmarks.panel import nicegui_page
from benchmarks.panel.presses import CHROMIUM, TIMEOUT_MS, Pages, button, daemon, executable, measured, served
from benchmarks.stop_times import cells

FOLDER: Final = Path(contid_panel.__file__).parent
#: What a STOP button and plots need of the panel.
NEEDED: Final = (
    *("access.py", "app.py", "guard.py", "hub.py", "limits.py", "mailbox.py", "page.py", "page_client.py"),
    *("server.py", "static/dom.js", "static/link.js", "static/plots.js", "static/stop.js"),
)
LOOK_S: Final = 10.0


@contextmanager
def niceguis(path: Path, *flags: str) -> Iterator[str]:
    """A NiceGUI page of a daemon; its URL."""
    process = subprocess.Popen(
        [sys.executable, "-m", "benchmarks.panel.nicegui_page", str(path), *flags],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    try:
        yield process.stdout.readline().strip()
    finally:
        process.terminate()
        process.wait(120.0)


def code_lines(paths: Sequence[Path]) -> int:
    """Lines that are neither empty nor a comment."""
    lines = (line.strip() for path in paths for line in path.read_text().splitlines())
    return sum(bool(line) and not re.match(r"#|//|\*|/\*", line) for line in lines)


def looked_at(url: str, ready: str) -> dict[str, Any]:
    """What a page loads and receives, what its browser computes, and what its policy refuses."""
    from playwright.sync_api import sync_playwright

    found = {"frames": 0, "frame_bytes": 0}
    responses: list[Any] = []
    errors: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable(), args=list(CHROMIUM))
        page = browser.new_page(viewport={"width": 1280, "height": 860})
        page.set_default_timeout(TIMEOUT_MS)
        page.on("console", lambda it: errors.append(it.text) if it.type == "error" else None)
        page.on("pageerror", lambda error: errors.append(str(error)))

        def received(data: str | bytes) -> None:
            found["frames"] += 1
            found["frame_bytes"] += len(data)

        page.on("response", lambda it: responses.append(it))
        page.on("websocket", lambda it: it.on("framereceived", received))
        page.goto(url)
        try:
            page.wait_for_selector(ready)
            shown = True
        except Exception:
            shown = False
        page.wait_for_timeout(2000)
        # Asked again: a page that loads itself once more has no bodies of its first time.
        files = {each.url for each in [*responses] if each.ok and "socket.io/?" not in each.url}
        loaded = [len(httpx.get(each).content) for each in files if each.startswith("http")]
        before, cpu = dict(found), processor_s()
        began_s = time.monotonic()
        page.wait_for_timeout(1e3 * LOOK_S)
        lasted_s = time.monotonic() - began_s
        used = (processor_s() - cpu) / lasted_s
        result = {
            "shown": shown,
            "requests": len(loaded),
            "loaded_kB": round(sum(loaded) / 1e3),
            "kB_per_s": round((found["frame_bytes"] - before["frame_bytes"]) / lasted_s / 1e3, 1),
            "messages_per_s": round((found["frames"] - before["frames"]) / lasted_s, 1),
            "browser_cores": round(used, 2),
            "refused": sum("Content Security Policy" in text for text in errors),
        }
        browser.close()
    return result


def processor_s() -> float:
    """Processor time of the browser that this process started [s]."""
    children = psutil.Process().children(recursive=True)
    times = [
        each.cpu_times()
        for each in children
        if "--type=" in " ".join(each.cmdline()) or "chrom" in each.name()
    ]
    return sum(each.user + each.system for each in times)


def latency(pages: Pages, ready: str, stop: str, count: int) -> str:
    """From a press to the tick that obeys [ms]: p50/p99 by where the time begins."""
    stops = measured(button(pages, ready, stop), count)
    texts = [
        f"{name or 'from playwright'} {'/'.join(cells(obeyed_s, (0.5, 0.99), 1e3, 1))} ms"
        for name, obeyed_s in stops.obeyed_s.items()
    ]
    return "; ".join(texts)


def strangers(url: str) -> dict[str, int]:
    """Statuses of requests that another site, another host name, and a program without the token make."""
    origin = url.partition("/#")[0].rstrip("/")
    paths = {
        "page": "/",
        "panel's stop": "/api/estop",
        "socket.io": "/_nicegui_ws/socket.io/?EIO=4&transport=polling",
    }
    headers = {
        "other site": {"origin": "http://evil.example"},
        "rebound name": {"host": "evil.example"},
        "no token": {"origin": origin},
    }
    found = {}
    for who, given in headers.items():
        for what, path in paths.items():
            method = "POST" if "stop" in what else "GET"
            found[f"{who}: {what}"] = httpx.request(method, origin + path, headers=given).status_code
    return found


def main() -> None:
    """Print what was measured."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--presses", type=int, default=60)
    count = parser.parse_args().presses
    pages: dict[str, tuple[Pages, str, str]] = {
        "panel": (served, ".robot[data-state=HOLD]", "#stop"),
        "NiceGUI": (niceguis, "[data-state]:has-text('HOLD')", "[data-stop]"),
    }
    for name, (way, ready, stop) in pages.items():
        with tempfile.TemporaryDirectory(prefix="contid-") as folder, daemon(Path(folder)) as path:
            with way(path) as url:
                print(f"{name}: {json.dumps(looked_at(url, ready))}", flush=True)
                print(f"{name}: {json.dumps(strangers(url))}", flush=True)
            if way is niceguis:
                with niceguis(path, "--policy") as url:
                    print(f"{name} with the panel's policy: {json.dumps(looked_at(url, ready))}", flush=True)
        if count:
            print(f"{name}: STOP, p50/p99: {latency(way, ready, stop, count)}", flush=True)
    print(f"panel: {code_lines([FOLDER / name for name in NEEDED])} lines")
    print(f"NiceGUI: {code_lines([Path(nicegui_page.__file__)])} lines")


if __name__ == "__main__":
    leave_on_sigterm()
    main()
