"""The sketch's core in virtual time: every millisecond of the board passes on a call of the test."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from contid.hal import AxisOnBus
from contid_devices.due.firmware_build import WARNINGS, build_host
from contid_drivers.due import frames, messages, wiring
from contid_drivers.due.codes import Type
from contid_drivers.due.messages import Answer, Refused, Telemetry
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role
from contid_drivers.due.wiring import DUE_ADC, Adc
from contid_emulate.due import plant_commands

MM_PER_REV = 78.53981633974483  # the 25 mm pinion of part B5: 60.80992066 counts/mm
REGULATOR: Mapping[str, Any] = {
    "calibration": [[0, 0], [100, 3]],
    "readback": [[600, 0], [3000, 3]],
    "ceiling_bar": 1.6,
    "wire_break_mv": 540,
}


class VirtualBoard:
    """One board with its plant, in lockstep with the test."""

    def __init__(self, role: str, journal: Path, program: Path, adc: Adc = DUE_ADC) -> None:
        self.role = role
        self.journal_file = journal
        self.adc = adc
        scale = ["--adc", str(adc.steps), f"{adc.mv:.0f}"]
        self._process = subprocess.Popen(
            [str(program), role, "--lockstep", "--journal", str(journal), *scale],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self._sequence = 0
        self.crc = 0
        self.telemetry: Telemetry | None = None
        self.step()  # a board listens after its first tick

    def close(self) -> None:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        self._process.stdout.close()
        assert self._process.wait(timeout=10) == 0, "the host build failed (sanitizer?)"

    def command(self, line: str) -> str:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline().rstrip("\n")
        assert answer.startswith("ok"), f"{line!r}: {answer!r}"
        return answer[3:]

    def step(self, ms: int = 1) -> None:
        self.command(f"step {ms}")

    def wire(self, data: bytes) -> bytes:
        """Bytes in, bytes out."""
        answer = self.command(f"rx {data.hex()}")
        return b"" if answer == "-" else bytes.fromhex(answer)

    def ask(self, kind: Type, body: bytes = b"") -> Answer | None:
        self._sequence = (self._sequence + 1) & 0xFF
        answer = self.wire(frames.seal(messages.request(kind, self._sequence, body)))
        if not answer:
            return None
        payload = frames.unseal(answer[:-1])
        assert payload is not None
        sequence, message = messages.read_answer(payload)
        assert sequence == self._sequence
        if isinstance(message, Telemetry):
            self.telemetry = message
        return message

    def configure(
        self, axes: Mapping[str, Mapping[str, Any]], watchdog_ms: int = 100, plant: bool = True
    ) -> Answer | None:
        """Channel -> options; the plant of each channel is made to fit them, or left as it is."""
        on_bus = []
        for channel, options in axes.items():
            defaults = REGULATOR if channel[0] == "p" else {}
            travel = (-1.0, 60.0) if channel[0] == "m" else None
            on_bus.append(
                AxisOnBus(
                    channel,
                    DueAxisOptions.model_validate({"channel": channel, **defaults, **options}),
                    travel,
                )
            )
        for axis in on_bus:
            for line in plant_commands(axis, self.adc) if plant else ():
                self.command(line)
        blob = wiring.board_config(
            "board", DueBusOptions(port="x", role=Role(self.role), watchdog_ms=watchdog_ms), on_bus, self.adc
        )
        answer = self.ask(Type.CONFIGURE, wiring.config_body(blob))
        if not isinstance(answer, Refused):
            self.crc = frames.crc16(blob)
        self.step(50)
        return answer

    def demand(
        self,
        values: Mapping[int, int] | None = None,
        echo_ms: int | None = None,
        velocities: Mapping[int, int] | None = None,
    ) -> Telemetry:
        echo = echo_ms if echo_ms is not None else self.telemetry.uptime_ms if self.telemetry else 0
        answer = self.ask(Type.DEMAND, messages.demand(self.crc, echo, values or {}, velocities))
        assert isinstance(answer, Telemetry), answer
        return answer

    def arm(self, *channels: int) -> Answer | None:
        self.demand()
        return self.ask(Type.ARM, messages.mask_body(self.crc, channels))

    def masked(self, kind: Type, *channels: int) -> Answer | None:
        return self.ask(kind, messages.mask_body(self.crc, channels))

    def truth(self, channel: int) -> list[float]:
        """Shaft [counts], speed [counts/s], pressure [Pa], rate [Pa/s], drive, duty, world time [ms]."""
        return [float(number) for number in self.command(f"get {channel}").split()]

    def journal(self, event: str) -> list[dict[str, Any]]:
        entries = [json.loads(line) for line in self.journal_file.read_text().splitlines()]
        return [entry for entry in entries if entry["event"] == event]

    def trip(self, channel: int = 0) -> dict[str, Any]:
        """The first entry of the journal in which the channel went to its safe state."""
        return next(e for e in self.journal("state") if e["channel"] == channel and e["state"] == "safe")


@pytest.fixture(scope="session")
def sanitized() -> Path:
    """The host build under ASan and UBSan: what every test in this folder runs on."""
    return build_host([*WARNINGS, "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g"])


@pytest.fixture
def board(tmp_path: Path, sanitized: Path) -> Iterator[Callable[..., VirtualBoard]]:
    """Makes boards: ``board("motor")``, ``board("motor", adc)``."""
    with ExitStack() as stack:

        def make(role: str, adc: Adc = DUE_ADC) -> VirtualBoard:
            made = VirtualBoard(role, tmp_path / f"{role}.journal", sanitized, adc)
            stack.callback(made.close)
            return made

        yield make
