"""Whatever happens to the host, every channel reaches its safe state in the configured time.

Motors run at 10 cm/s, regulators stand at 1.5 bar when it happens; the times are the emulated board's own,
from its journal. A motor whose demands end runs out towards the last of them before the watchdog brakes it.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest

from contid.hal import AxisOnBus
from contid.robot_file.load import load_robot_file
from contid_drivers.due import frames, messages, wiring
from contid_drivers.due.codes import Type
from contid_drivers.due.options import DueBusOptions
from contid_emulate.due import DueEmulator

pytestmark = [pytest.mark.process, pytest.mark.realtime]

TEN_CM_S = 6081.0  # counts/s
WATCHDOG_MS = 100
# From 1.5 bar at 2 bar/s, and the regulator's lag.
VENT_MS = 750 + 250


class Board:
    """One emulated board of a shipped robot file, with its journal."""

    def __init__(self, robot: str, folder: Path, configs: Path) -> None:
        self.file = folder / f"{robot}.yaml"
        # The pneumatic model is slow without its compiled kernel; the rate is not what is tested here.
        text = (configs / f"{robot}.emulated.yaml").read_text().replace("rate_hz: 500", "rate_hz: 50")
        # Nor is how soon a busy machine lets the emulator answer.
        text = re.sub(r"role: \w+", r"\g<0>\n    latency_ms: 150", text)
        self.file.write_text(text.replace("port: ./", f"port: {folder}/"))
        (wired,) = load_robot_file(self.file).buses.values()
        self.axes = [AxisOnBus(name, options, None) for name, options in wired.axes]
        assert isinstance(wired.options, DueBusOptions)
        self.options = wired.options
        self.journal_file = folder / "journal"
        self.emulator = DueEmulator(self.options, self.axes, self.journal_file)

    def truth(self, channel: int) -> list[float]:
        return [float(number) for number in self.emulator.command(f"get {channel}").split()]

    def journal(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.journal_file.read_text().splitlines()]

    def wait(self, what: Callable[[], bool], seconds: float = 30.0) -> None:
        end = time.monotonic() + seconds
        while not what():
            assert time.monotonic() < end, "it did not happen"
            time.sleep(0.01)

    def working(self) -> bool:
        """Every axis runs at 10 cm/s, or stands at 1.5 bar."""
        if self.options.role == "motor":
            return all(self.truth(i)[1] > 0.95 * TEN_CM_S for i in range(3))
        return all(self.truth(i)[2] > 148_000 for i in range(3))

    def check_safe_state(self) -> None:
        """Every channel tripped by the watchdog, on time, and came to rest afterwards."""

        def all_at_rest() -> bool:
            trips = {e["channel"]: e for e in self.journal() if e.get("state") == "safe"}
            rests = {
                e["channel"]
                for e in self.journal()
                if e["event"] == "rest"
                and e["channel"] in trips
                and e["world_ms"] >= trips[e["channel"]]["world_ms"]
            }
            return rests == {0, 1, 2}

        self.wait(all_at_rest)
        motors = self.options.role == "motor"
        for channel in range(3):
            trip = next(e for e in self.journal() if e.get("state") == "safe" and e["channel"] == channel)
            rest = next(
                e
                for e in self.journal()
                if e["event"] == "rest" and e["channel"] == channel and e["world_ms"] >= trip["world_ms"]
            )
            assert (trip["reason"], trip["silence_ms"]) == ("watchdog", WATCHDOG_MS)
            if not motors:
                assert trip["value"] == pytest.approx(150_000, rel=0.02)
            assert rest["world_ms"] - trip["world_ms"] <= (200 if motors else VENT_MS)


@pytest.fixture(params=["trirack", "stiffflop1"])
def board(request: pytest.FixtureRequest, tmp_path: Path, configs: Path) -> Iterator[Board]:
    made = Board(request.param, tmp_path, configs)
    with made.emulator:
        yield made


def _trajectory(board: Board) -> str:
    if board.options.role == "motor":
        return "t_s,s1.l1_mm,s1.l2_mm,s1.l3_mm\n0,60,60,60\n5.5,610,610,610\n"
    return "t_s,s1.p1_bar,s1.p2_bar,s1.p3_bar\n0,0,0,0\n1.5,1.5,1.5,1.5\n60,1.5,1.5,1.5\n"


@contextmanager
def _contid(board: Board) -> Iterator[subprocess.Popen[bytes]]:
    path = board.file.with_suffix(".csv")
    path.write_text(_trajectory(board))
    command = [sys.executable, "-m", "contid", "run", str(board.file), "--trajectory", str(path)]
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
    )
    try:
        yield process
    finally:
        for one in _family(process.pid):
            one.kill()
        process.communicate()


def _family(pid: int) -> list[psutil.Process]:
    try:
        parent = psutil.Process(pid)
        return [parent, *parent.children(recursive=True)]
    except psutil.NoSuchProcess:
        return []


def test_kill_9_of_daemon_and_control_process(board):
    with _contid(board) as process:
        board.wait(board.working)
        family = _family(process.pid)
        # The control process is a child: both are there, and both die in the same instant.
        assert len(family) >= 2
        for one in family:
            one.suspend()
        for one in family:
            one.send_signal(signal.SIGKILL)
        board.check_safe_state()


def test_frozen_loop(board):
    with _contid(board):
        board.wait(board.working)
        board.emulator.command("watchdog 0")  # without the hardware watchdog: the watchdog alone
        board.emulator.switch({"fault": "freeze"})
        board.check_safe_state()


def test_port_that_stays_open_but_is_not_read(board):
    """The host goes on sending good demands and never reads an answer again."""
    blob = wiring.board_config("board", board.options, board.axes)
    crc = frames.crc16(blob)
    fd = os.open(board.options.port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        reader = frames.FrameReader()

        def ask(kind: Type, body: bytes) -> Any:
            os.write(fd, frames.seal(messages.request(kind, 1, body)))
            while True:
                time.sleep(0.001)
                try:
                    answers = list(reader.feed(os.read(fd, 4096)))
                except BlockingIOError:
                    continue
                if answers:
                    return messages.read_answer(answers[-1])[1]

        assert termios.tcgetattr(fd)
        ask(Type.CONFIGURE, wiring.config_body(blob))
        telemetry = ask(Type.DEMAND, messages.demand(crc, 0, {}))
        telemetry = ask(Type.ARM, messages.mask_body(crc, range(3)))
        start = {channel: telemetry.channels[channel].position for channel in range(3)}
        began = telemetry.uptime_ms

        def goals(uptime_ms: int) -> dict[int, int]:
            if board.options.role == "pressure":
                return dict.fromkeys(range(3), 150_000)
            return {c: round(p + TEN_CM_S * (uptime_ms - began) / 1000) for c, p in start.items()}

        end = time.monotonic() + 20.0
        while not board.working() and time.monotonic() < end:
            telemetry = ask(
                Type.DEMAND, messages.demand(crc, telemetry.uptime_ms, goals(telemetry.uptime_ms))
            )
        assert board.working()
        for i in range(100):
            body = messages.demand(crc, telemetry.uptime_ms, goals(telemetry.uptime_ms + 5 * i))
            os.write(fd, frames.seal(messages.request(Type.DEMAND, 1, body)))
            time.sleep(0.005)
        board.check_safe_state()
    finally:
        os.close(fd)
