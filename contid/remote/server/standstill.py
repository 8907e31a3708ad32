"""The check of a timed trajectory from where its robots stand still.

They hold meanwhile: the transfer of a long trajectory may cost more than a tick. What a robot reaches depends
on where it stands, so the trajectory is checked again if a robot has moved since the first check.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Final

from contid.control.daemon.interfaces import RunControl
from contid.control.engine.messages import Hold
from contid.control.engine.tick_layout import TickRecord
from contid.control.tick.supervisor import MOVING, Mode
from contid.remote.protocol.wire import Code, RemoteError
from contid.remote.server.pending_orders import PendingOrders
from contid.remote.server.telemetry_view import TelemetryView
from contid.trajectory.timed import Trajectory

#: Time for robots to stand still, and the period of that check.
STANDSTILL_TIMEOUT_S: Final = 20.0
POLL_S: Final = 0.02


async def checked_at_rest(
    control: RunControl,
    view: TelemetryView,
    pending: PendingOrders,
    check: Callable[[TickRecord | None], Awaitable[Trajectory]],
    check_current: Callable[[], None],
) -> Trajectory:
    """The trajectory that ``check`` finds from a record, in a thread: a stop meanwhile has its response.

    Raises:
        RemoteError: of the check; of ``check_current``, when the move ended meanwhile and robots may move for
            another client, which are left alone; or a robot still moves after `STANDSTILL_TIMEOUT_S`.
    """
    record = control.newest()
    trajectory = await check(record)
    check_current()
    await pending.confirmed(pending.send([Hold()]))
    stands = await _standstill(control, view)
    if _commands(view, stands) != _commands(view, record):
        trajectory = await check(stands)
    return trajectory


async def _standstill(control: RunControl, view: TelemetryView) -> TickRecord:
    """Wait until nothing moves. A robot that brakes in HOLD moves: of two records the commands are equal."""
    before: TickRecord | None = None
    for _ in range(int(STANDSTILL_TIMEOUT_S / POLL_S)):
        record = control.newest()
        if record is None or any(Mode(robot.mode) in MOVING for robot in record.robots):
            before = None
        elif before is None or record.tick > before.tick:
            if before is not None and _commands(view, record) == _commands(view, before):
                return record
            before = record
        await asyncio.sleep(POLL_S)
    message = f"the robots did not stand still within {STANDSTILL_TIMEOUT_S:g} s"
    raise RemoteError(Code.REFUSED, message)


def _commands(view: TelemetryView, record: TickRecord | None) -> list[tuple[float, ...] | None]:
    """The last command of every robot in a record."""
    return [view.command(name, record) for name in view.configs]
