"""How a panel is started and ends: beside a run, as a demonstration, over TLS; what is refused."""

from __future__ import annotations

import asyncio
import math
import os
import re
import shutil
import signal
import ssl
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import httpx
import numpy as np
import psutil
import pytest

from contid.robot_file.load import load_named
from contid_panel.demo_motion import demo_motion
from contid_panel.geometry import PanelGeometry
from contid_panel.hub import Hub
from contid_panel.mailbox import Mailbox
from contid_panel.server import PanelError, PanelSettings
from tests.support.daemons import Running, armed_daemon, command
from tests.support.panels import PanelProcess, page, panel
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]


@contextmanager
def _demonstration(folder: Path, *arguments: str) -> Iterator[tuple[subprocess.Popen[str], PanelProcess]]:
    """`contid demo` in an empty folder, with something in stdin that is no trajectory."""
    process = subprocess.Popen(
        command("demo", "--no-open", *arguments),
        cwd=folder,
        env={**os.environ, "XDG_RUNTIME_DIR": str(folder)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    assert process.stdin is not None
    process.stdin.write("nonsense\n")
    process.stdin.flush()
    try:
        for line in process.stderr:
            if found := re.search(r"http://127\.0\.0\.1:(\d+)/#([\w-]+)", line):
                break
        assert found is not None
        yield process, PanelProcess(process, found[0], int(found[1]), found[2])
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def test_a_panel_goes_before_the_clients_that_flood_the_daemon() -> None:
    probe = "import os; os.setpriority(os.PRIO_PROCESS, 0, -5)"
    if subprocess.run([sys.executable, "-c", probe], capture_output=True).returncode:
        pytest.skip("negative nice values need CAP_SYS_NICE or LimitNICE")
    with armed_daemon(1) as running, panel(running) as served:
        assert psutil.Process(served.process.pid).nice() <= -5


async def _holds(served: PanelProcess) -> None:
    async with page(served) as it:
        await it.until(lambda page: page.state("left") == "HOLD")


async def _moves_until_it_is_touched(served: PanelProcess) -> None:
    async with page(served) as it:
        await it.until(lambda page: page.state("left") == "RUN")
        assert it.newest["hello"]["demo"]
        start = {robot: it.tip_mm(robot) for robot in ("left", "right")}
        for robot, tip in start.items():
            await it.until(lambda page, robot=robot, tip=tip: math.dist(page.tip_mm(robot), tip) > 10.0)  # type: ignore[misc]
        assert (await it.order("acquire", takeover=True))["ok"]
        await it.until(lambda page: page.state("left") == page.state("right") == "HOLD")


def _panels_of(process: subprocess.Popen[str]) -> list[psutil.Process]:
    children = psutil.Process(process.pid).children(recursive=True)
    return [child for child in children if "panel" in child.cmdline()]


def test_the_demonstration_holds_and_ends_with_ctrl_c(tmp_path: Path) -> None:
    with _demonstration(tmp_path, "--still") as (process, served):
        asyncio.run(_holds(served))
        (child,) = _panels_of(process)
        assert child.nice() >= psutil.Process(process.pid).nice()  # robots go first
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=30)
        assert process.returncode == 130, errors
        assert "Traceback" not in errors
        assert not child.is_running()


@pytest.mark.parametrize("name", ["hand", "tendon3"])
def test_a_demonstration_stays_within_every_limit(name: str) -> None:
    """The run itself judges it: `contid run --virtual` refuses what is out of reach or too fast."""
    loaded = load_named(name)
    motion = demo_motion(loaded, loaded.file.rate_hz)
    assert motion is not None
    text = motion.csv(10.0)
    found = subprocess.run(command("run", name, "--virtual"), input=text, capture_output=True, text=True)
    assert found.returncode == 0, found.stderr
    values = np.array([[float(cell) for cell in row.split(",")] for row in text.splitlines()[1:]])
    assert np.ptp(values[:, 1:], axis=0).min() > 1.0  # [mm]: every axis is seen to move


def test_the_demonstration_moves_until_it_is_touched(tmp_path: Path) -> None:
    with _demonstration(tmp_path) as (_, served):
        asyncio.run(_moves_until_it_is_touched(served))


def test_a_panel_ends_when_its_run_is_killed(tmp_path: Path) -> None:
    with _demonstration(tmp_path, "--still") as (process, served):
        asyncio.run(_holds(served))
        (child,) = _panels_of(process)
        process.kill()
        until(lambda: not child.is_running() or child.status() == psutil.STATUS_ZOMBIE, "the panel has ended")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "hand", "--virtual", "--panel"], "--panel needs a daemon in real time"),
        (["panel", "--socket", "S", "--host", "0.0.0.0"], "--allow-remote"),
        (["panel", "--socket", "S", "--host", "0.0.0.0", "--allow-remote"], "--tls-certificate"),
        (["panel", "--socket", "S", "--host", "::"], "--allow-remote"),
        (["panel", "--socket", "S", "--tls-key", "S"], "given together"),
        (["panel", "--socket", "S", "--port", "99999"], "99999"),
        (["panel", "--socket", "absent"], "absent: no daemon listens"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, arguments: list[str], message: str) -> None:
    (tmp_path / "S").touch()
    done = subprocess.run(
        command(*arguments),
        cwd=tmp_path,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.7", "robot.example", ""])
def test_only_loopback_needs_no_flags(host: str) -> None:
    with pytest.raises(PanelError):
        PanelSettings(Path("s"), host=host).check()


@pytest.mark.parametrize("host", ["0.0.0.0", "::", ""])
def test_every_address_needs_a_name(host: str) -> None:
    settings = PanelSettings(Path("s"), host, allow_remote=True, certificate=Path("c"), key=Path("k"))
    with pytest.raises(PanelError, match="add --name"):
        settings.check()
    replace(settings, names=("robot.example",)).check()
    replace(settings, host="192.168.1.7").check()


@pytest.mark.parametrize("host", ["127.0.0.1", "127.1.2.3", "::1", "localhost"])
def test_loopback_needs_no_flags(host: str) -> None:
    PanelSettings(Path("s"), host=host).check()


@pytest.fixture
def running() -> Iterator[Running]:
    with armed_daemon() as started:
        yield started


def test_an_error_while_drawing_is_reported_and_the_panel_goes_on(
    running: Running, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A model that contid does not have may raise anything; the pages must not just stand still."""

    def fails(*_: object) -> None:
        raise RuntimeError("no such shape")

    async def watched() -> list[str]:
        hub, mailbox, seen = Hub(running.socket), Mailbox(), []
        hub.join(mailbox)
        with monkeypatch.context() as broken:
            broken.setattr(PanelGeometry, "bodies", fails)
            reading = asyncio.create_task(hub.run())
            seen.append(await _message(mailbox, "an error of the panel"))
        seen.append(await _message(mailbox, '"kind":"frame"'))
        reading.cancel()
        await asyncio.gather(reading, return_exceptions=True)
        return seen

    error, _ = asyncio.run(watched())
    assert '"connected":false' in error
    assert "no such shape" in caplog.text


async def _message(mailbox: Mailbox, part: str) -> str:
    """The next message that has this part."""
    async with asyncio.timeout(20.0):
        while part not in (text := await mailbox.take() or ""):
            pass
    return text


def test_the_command_line_of_a_browser_has_no_token(
    running: Running, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And a browser that stays in the foreground does not keep the panel from serving."""
    browser = tmp_path / "browser"
    browser.write_text('#!/bin/sh\necho "$@" > "$0.new"\nmv "$0.new" "$0.arguments"\nexec sleep 60\n')
    browser.chmod(0o755)
    monkeypatch.setenv("BROWSER", f"{browser} %s")
    monkeypatch.setenv("HOME", str(tmp_path))
    arguments = tmp_path / "browser.arguments"
    with panel(running, "--open") as served:
        until(arguments.exists, "the browser was started", 20.0)
        assert httpx.get(served.origin + "/", timeout=5.0).status_code == 200
        given = arguments.read_text().strip()
        assert served.token not in given
        page_file = Path(given.removeprefix("file://"))
        assert served.url in page_file.read_text()
        assert page_file.parent.stat().st_mode & 0o077 == 0
        for process in psutil.Process(served.process.pid).children(recursive=True):
            process.kill()


@pytest.mark.skipif(shutil.which("openssl") is None, reason="no openssl for a certificate")
def test_a_remote_panel_is_served_over_tls_only(running: Running, tmp_path: Path) -> None:
    key, certificate = tmp_path / "key.pem", tmp_path / "certificate.pem"
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=localhost",
         "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1", "-keyout", key, "-out", certificate],
        check=True, capture_output=True,
    )  # fmt: skip
    remote = ["--host", "0.0.0.0", "--name", "localhost", "--allow-remote"]
    flags = [*remote, "--tls-certificate", certificate, "--tls-key", key]
    with panel(running, *map(str, flags)) as served:
        context = ssl.create_default_context(cafile=certificate)
        assert httpx.get(f"https://127.0.0.1:{served.port}/", verify=context).status_code == 200
        with pytest.raises(httpx.HTTPError):
            httpx.get(f"http://127.0.0.1:{served.port}/")
        headers = {"authorization": f"Bearer {served.token}", "origin": f"https://127.0.0.1:{served.port}"}
        url = f"https://127.0.0.1:{served.port}/api/estop"
        assert httpx.post(url, headers=headers, verify=context).status_code == 200
        headers["origin"] = f"http://127.0.0.1:{served.port}"
        assert httpx.post(url, headers=headers, verify=context).status_code == 403


def test_a_touch_of_the_page_ends_the_demonstration(tmp_path: Path) -> None:
    sync_api = pytest.importorskip("playwright.sync_api", reason="pip install 'contid[test]'")
    from tests.support.browser import chromium, opened

    with (
        _demonstration(tmp_path) as (_, served),
        sync_api.sync_playwright() as playwright,
        chromium(playwright, draws=False) as browser,
        opened(browser, served) as it,
    ):
        it.state("left", "RUN")
        assert "Demonstration" in it.text("#lease")
        it.page.locator("#view").click()
        it.page.wait_for_selector("#lease[data-mine=true]")
        it.state("left", "HOLD")
        it.state("right", "HOLD")
