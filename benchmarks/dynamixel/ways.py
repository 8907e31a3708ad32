"""Ways to read a bus: packets ready-made, the stock SDK, this driver."""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

from benchmarks.dynamixel.rows import Row, measure, wire_limit
from contid.control.engine.cycle import RealClock
from contid.errors import DeviceError
from contid.hal import AxisOnBus, Rest
from contid_drivers.dynamixel import link
from contid_drivers.dynamixel.bus import DynamixelBus
from contid_drivers.dynamixel.exchange.block import CyclicLayout, ServoReading
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions
from contid_drivers.dynamixel.packets import sync_read, sync_write
from contid_drivers.dynamixel.port import ServoPort

#: The SDK waits this much longer for an answer than its bytes take; so does contid here, for what a busy
#: machine delays. By default it gives up earlier, because a tick does not wait.
SDK_WAIT_MS = 34.0


def goals() -> Iterator[float]:
    """A slow sine, so that the servos really move."""
    start = time.monotonic()
    while True:
        yield math.pi + 0.2 * math.sin(time.monotonic() - start)


@dataclass(frozen=True)
class Case:
    """A bus and a way to read it."""

    port: str
    count: int
    baud: int
    fast: bool
    seconds: float

    def row(self, what: str, size: int) -> Row:
        """An empty row."""
        name = what + (", fast read" if self.fast else "")
        return Row(name, self.count, self.baud, size, wire_limit(self.count, size, self.baud, self.fast))


def wire_alone(case: Case, row: Row) -> None:
    """Packets ready-made, answers only counted."""
    ids = range(1, case.count + 1)
    port = ServoPort("wire", case.port, case.baud, 0.0)
    here = ((device, (2048).to_bytes(4, "little")) for device in ids)
    wire = sync_write(116, 4, here) + sync_read(126, 10, list(ids), case.fast)
    whole = 8 + case.count * 14 if case.fast else case.count * 21

    def cycle() -> int:
        left, deadline = whole, port.send(wire) + 0.03
        while left > 0 and (data := port.receive(deadline)):
            left -= len(data)
        return case.count if left else 0

    measure(row, case.seconds, cycle)
    port.close()


def stock(case: Case, row: Row) -> None:
    import dynamixel_sdk as sdk

    handler, protocol = sdk.PortHandler(case.port), sdk.PacketHandler(2.0)
    handler.setBaudRate(case.baud)
    write: Any = sdk.GroupSyncWrite(handler, protocol, 116, 4)
    read: Any = sdk.GroupSyncRead(handler, protocol, 126, 10)
    for device in range(1, case.count + 1):
        read.addParam(device)
    goal = goals()

    def cycle() -> int:
        ticks = round(next(goal) / (2 * math.pi) * 4096)
        write.clearParam()
        for device in range(1, case.count + 1):
            write.addParam(device, list(ticks.to_bytes(4, "little")))
        write.txPacket()
        result = read.fastSyncRead() if case.fast else read.txRxPacket()
        for device in range(1, case.count + 1):
            for address, size in ((126, 2), (128, 4), (132, 4)):
                read.getData(device, address, size)
        return 0 if result == 0 else case.count

    measure(row, case.seconds, cycle)
    handler.closePort()


def enable(bus: DynamixelBus) -> None:
    """Open and arm; on a busy machine the emulated wire may be stopped for too long, so three times."""
    for left in (2, 1, 0):
        try:
            bus.open()
            bus.enable(bus.axes)
            return
        except DeviceError:
            bus.close()
            if not left:
                raise


class MotionLayout(CyclicLayout):
    """Only current, velocity and position, as the stock SDK reads."""

    def decode(self, data: bytes, alert: bool) -> ServoReading:
        """Decode a block read with this layout."""
        current, velocity, position = struct.unpack("<hii", data)
        return ServoReading(current, velocity, position, alert)


MOTION = MotionLayout(126, 10, 10)


def driver(
    case: Case, row: Row, motion_only: bool = False, every: int = 1, mute: Callable[[], None] | None = None
) -> None:
    """This driver; ``mute`` silences a servo once the bus is open and torque is on."""
    options = DynamixelBusOptions.model_validate({
        "port": case.port, "baud": case.baud, "fast_read": "auto" if case.fast else "off",
        "telemetry_every": every, "slack_ms": SDK_WAIT_MS, "retry_ms": SDK_WAIT_MS,
    })  # fmt: skip
    axes = [AxisOnBus(f"r.a{i + 1}", DynamixelAxisOptions(id=i + 1)) for i in range(case.count)]
    bus = DynamixelBus("servos", options, axes, RealClock())
    goal = goals()
    try:
        with patch.object(link, "common_layout", lambda _: MOTION) if motion_only else nullcontext():
            enable(bus)

        def cycle() -> int:
            invalid = 0
            for sample in bus.exchange(dict.fromkeys(bus.axes, next(goal))).values():
                if sample.fault:
                    raise SystemExit(
                        f"{row.what}: {sample.fault}; its goals are no longer sent, so the row would flatter"
                    )
                invalid += not sample.valid
            return invalid

        if mute is not None:
            mute()
        measure(row, case.seconds, cycle)
    finally:
        bus.disable(bus.axes, Rest.RELAX)
        bus.close()
