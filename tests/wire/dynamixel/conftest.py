"""A real driver on an emulated bus."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from contid.control.engine.cycle import RealClock
from contid.hal import AxisOnBus, Sample
from contid_drivers.dynamixel.bus import DynamixelBus
from contid_drivers.dynamixel.link import Opened
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions
from contid_emulate.dynamixel import DynamixelEmulator, Servo
from tests.wire.dynamixel.virtual_wire import InlineEmulator
from tests.wire.wire_time import WireTime

# Generous, because tests share the machine; nothing here is about time.
PATIENT = {"usb_latency_ms": 40.0, "retry_ms": 80.0, "watchdog_ms": 2000}


@dataclass
class Rig:
    """An emulated bus and the driver on it."""

    emulator: DynamixelEmulator
    bus: DynamixelBus
    options: DynamixelBusOptions
    axes: tuple[AxisOnBus, ...]

    def as_another_process(self) -> None:
        """Replace the bus by one that has not met these servos."""
        self.bus.close()
        self.bus = DynamixelBus("servos", self.options, self.axes, RealClock())

    @property
    def opened(self) -> Opened:
        """The open port of the bus."""
        return self.bus._link.need_open()

    def tick(self, times: int = 1, **commands: float) -> Mapping[str, Sample]:
        """Exchange; commands by axis without the robot's name."""
        samples: Mapping[str, Sample] = {}
        for _ in range(times):
            samples = self.bus.exchange({f"r.{axis}": value for axis, value in commands.items()})
        return samples

    def until(self, condition: Callable[[], bool], timeout_s: float = 30.0) -> None:
        """Tick until something is true."""
        deadline = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < deadline, "it never became true"
            self.tick()
            time.sleep(0.002)


def servos(count: int, **servo: Any) -> list[Servo]:
    made = [Servo(i + 1, **{"position_ticks": 1000.0 * (i + 1), **servo}) for i in range(count)]
    for each in made:
        each.memory[9] = 0
    return made


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Callable[..., Rig]]:
    """Make rigs: ``rig(count, axis={...}, servo={...}, options...)``; axes are r.a1, r.a2, ..

    In real time, or in ``time``.
    """
    with ExitStack() as stack:

        def make(
            count: int = 2,
            axis: Mapping[str, Any] | None = None,
            servo: Mapping[str, Any] | None = None,
            travel: tuple[float, float] | None = None,
            made: Sequence[Servo] | None = None,
            time: WireTime | None = None,
            **options: Any,
        ) -> Rig:
            emulator = (DynamixelEmulator if time is None else InlineEmulator)(
                made if made is not None else servos(count, **(servo or {})),
                tmp_path / "servos.pty",
                tmp_path / "faults.jsonl",
                paced=False,
            )
            stack.enter_context(emulator)
            if time is not None:
                assert isinstance(emulator, InlineEmulator)
                time.devices = (emulator,)
            wired = tuple(
                AxisOnBus(f"r.a{i + 1}", DynamixelAxisOptions(id=i + 1, **(axis or {})), travel)
                for i in range(count)
            )
            given = DynamixelBusOptions(**{"port": emulator.port, **PATIENT, **options})
            bus = DynamixelBus("servos", given, wired, RealClock())
            rig = Rig(emulator, bus, given, wired)
            stack.callback(lambda: rig.bus.close())
            return rig

        yield make
