"""Waiting until the robots of a run stand still."""

from __future__ import annotations

import asyncio
from typing import Final

from contid.control.daemon.interfaces import RunControl
from contid.control.engine.tick_layout import TickRecord
from contid.control.tick.supervisor import MOVING, Mode
from contid.remote.protocol.wire import Code, RemoteError
from contid.remote.server.telemetry_view import TelemetryView

#: Time for robots to stand still before a trajectory is played, and the period of that check.
STANDSTILL_TIMEOUT_S: Final = 20.0
POLL_S: Final = 0.02


async def standstill(control: RunControl, view: TelemetryView) -> TickRecord:
    """Wait until nothing moves: the transfer of a long trajectory may cost more than a tick.

    A robot that brakes in HOLD moves: of two records the commands must be equal.

    Raises:
        RemoteError: something still moves after `STANDSTILL_TIMEOUT_S`.
    """
    before: TickRecord | None = None
    for _ in range(int(STANDSTILL_TIMEOUT_S / POLL_S)):
        record = control.newest()
        if record is not None and not any(Mode(robot.mode) in MOVING for robot in record.robots):
            if before is None or record.tick > before.tick:
                if before is not None and commands(view, record) == commands(view, before):
                    return record
                before = record
        else:
            before = None
        await asyncio.sleep(POLL_S)
    message = f"the robots did not stand still within {STANDSTILL_TIMEOUT_S:g} s"
    raise RemoteError(Code.REFUSED, message)


def commands(view: TelemetryView, record: TickRecord | None) -> list[tuple[float, ...] | None]:
    """The last command of every robot in a record."""
    return [view.command(name, record) for name in view.configs]
