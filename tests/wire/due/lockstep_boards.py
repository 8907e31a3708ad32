"""Boards on plugs: the firmware's core in lockstep with the time of its host, each with its own chip."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import NamedTuple

import pytest

from contid.hal import AxisOnBus
from contid.kit import locked_port
from contid_devices.due import homing, pulses
from contid_devices.due.firmware_build import build_host
from contid_driverkit.clock import MonotonicClock
from contid_driverkit.pseudo_port import PseudoPort
from contid_drivers.due import bus, frames, session
from contid_drivers.due.codes import Type
from contid_emulate.due import plant_commands
from tests.wire.wire_time import WireTime, wire_time

#: Where the core's one identity stands in an answer (firmware/PROTOCOL.md).
FIRMWARE, CHIP, BOOT_IN_HELLO, BOOT_IN_TELEMETRY = slice(5, 8), slice(12, 28), slice(30, 34), slice(9, 13)


class Body(NamedTuple):
    """What a motor does."""

    shaft: float
    speed: float
    drive: int
    duty: int


class LockstepBoard(AbstractContextManager["LockstepBoard"]):
    """One board; its answers carry its own chip, start and version."""

    def __init__(self, chip: int, axes: Sequence[AxisOnBus], parts: Sequence[str] = ()) -> None:
        self.chip, self.firmware = chip, bytes((1, 7, 0))
        self._reader = frames.FrameReader()
        self._taken_ms = 0
        command = [str(build_host()), "motor", "--lockstep", *parts]
        for axis in axes:
            for line in plant_commands(axis):
                command += ["--world", line]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )

    def __exit__(self, *_: object) -> None:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        self._process.stdout.close()
        self._process.wait(timeout=10)

    def command(self, line: str) -> str:
        """One command of firmware/host/README.md; what it answers."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline().strip()
        assert answer.startswith("ok"), (line, answer)
        return answer[3:]

    def body(self, channel: int) -> Body:
        """A motor, as it is."""
        shaft, speed, _, _, drive, duty, _ = self.command(f"get {channel}").split()
        return Body(float(shaft), float(speed), int(drive), int(duty))

    def turn(self, now_s: float, received: bytes) -> bytes:
        """Come to a time and take bytes; what the board sends."""
        now_ms = int(now_s * 1000.0)
        sent = ""
        if self._taken_ms and now_ms > self._taken_ms:
            sent += self.command(f"step {now_ms - self._taken_ms}").strip("-")
        self._taken_ms = now_ms
        if received:
            sent += self.command(f"rx {received.hex()}").strip("-")
        return b"".join(self._as_this_chip(one) for one in self._reader.feed(bytes.fromhex(sent)))

    def _as_this_chip(self, payload: bytes) -> bytes:
        answer = bytearray(payload)
        boot = None
        if answer[1] == Type.HELLO_ANSWER:
            answer[FIRMWARE], answer[CHIP] = self.firmware, bytes((self.chip,)) * 16
            boot = BOOT_IN_HELLO
        elif answer[1] == Type.TELEMETRY:
            boot = BOOT_IN_TELEMETRY
        if boot is not None:
            answer[boot] = bytes((answer[boot][0], answer[boot][1], self.chip, 0xB0))
        return frames.seal(bytes(answer))


class Plugs(AbstractContextManager["Plugs"]):
    """Ports by name, and the board behind each; None where the cable is out."""

    def __init__(self, names: Sequence[Path], boards: Sequence[LockstepBoard]) -> None:
        self.boards = boards
        self.behind: list[LockstepBoard | None] = list(boards[: len(names)])
        self._ports = [PseudoPort(name) for name in names]
        self.plug()

    def __exit__(self, *_: object) -> None:
        self.unplug()

    def plug(self) -> None:
        """The ports appear."""
        for port in self._ports:
            port.plug()

    def unplug(self) -> None:
        """The ports vanish."""
        for port in self._ports:
            port.unplug()

    def turn(self, now_s: float) -> None:
        """Come to a time; bytes go to the boards and back."""
        for board in self.boards:
            port = self._ports[self.behind.index(board)] if board in self.behind else None
            sent = board.turn(now_s, port.read() if port is not None and port.plugged else b"")
            if sent and port is not None and port.plugged:
                port.write(sent)
        for plugged, port in zip(self.behind, self._ports, strict=True):
            if plugged is None and port.plugged:
                port.read()


def board_time(monkeypatch: pytest.MonkeyPatch) -> WireTime:
    """Host and boards in one time until the test ends."""
    timed = (locked_port, frames, session, bus, homing, pulses)
    made = wire_time(monkeypatch, timed, (locked_port, frames), longest_s=20e-3)
    monkeypatch.setattr(MonotonicClock, "now", made.now)
    monkeypatch.setattr(MonotonicClock, "sleep", made.sleep)
    return made
