"""Orders that move, or let robots move again: they need the lease, which a stop by another client revokes.

Each method answers one verb of the protocol. It reads the fields of the request (`RequestFields.end` refuses
those that are left), checks the lease, gives orders to the control process, and returns what those led to.
`_resume`, `_recover`, `_move` and `_grip` wait until a tick carried the order out.

A stop stands until a client lets robots go on. An order that was refused lifts none (`Lease.end_stop`).
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import ChainMap
from collections.abc import Mapping
from functools import partial
from typing import Final, NamedTuple

from contid.control.engine.events.robots import OrderRefused
from contid.control.engine.messages import ClearFault, Grip, Hold, Recover, Resume
from contid.control.engine.tick_layout import TickRecord
from contid.control.tick.supervisor import Mode
from contid.remote.protocol.wire import Code, Fields, RemoteError, RequestFields
from contid.remote.server.lease import (
    INPUT_CLIENT,
    MAX_TIMEOUT_S,
    MIN_TIMEOUT_S,
    TIMEOUT_S,
    LeaseHolder,
    client_label,
)
from contid.remote.server.pending_orders import CONFIRM_TIMEOUT_S
from contid.remote.server.query_handler import Caller, Verb
from contid.remote.server.served_run import ServedRun

log = logging.getLogger(__name__)

#: Greatest force of a move until a force [N].
MAX_FORCE_N: Final = 1000.0
#: Interval in which `clear-fault` looks whether robots left FAULT.
_LOOK_S: Final = 0.02
#: Greatest number of a move, and greatest time of the monotonic clock [s], that a request may have.
_MAX_NUMBER: Final = 1e15
_MAX_TIME_S: Final = 1e12


class _StillFaulty(NamedTuple):
    """Robots that did not leave FAULT, and the record that shows it."""

    robots: tuple[str, ...]
    record: TickRecord | None


class MotionOrders:
    """The verbs of the lease, of arming and of moves."""

    def __init__(self, run: ServedRun) -> None:
        self._run = run
        #: Newest refusals that answer no order: those of devices that are to be cleared.
        self._refusals: dict[str, str] = {}

    @property
    def verbs(self) -> dict[str, Verb]:
        """Method of each verb."""
        unchecked: dict[str, Verb] = {
            Resume.NAME: self._resume, ClearFault.NAME: self._clear_fault, Recover.NAME: self._recover,
            Grip.NAME: self._grip, "acquire": self._acquire, "release": self._release, "end": self._end,
            "start": self._start,
        }  # fmt: skip
        checked: dict[str, Verb] = {"move": self._move, "rows": self._rows}
        return {
            **{name: partial(self._after_checks, name, verb) for name, verb in unchecked.items()},
            **{name: partial(self._in_turn, name, verb) for name, verb in checked.items()},
        }

    async def _after_checks(self, name: str, verb: Verb, caller: Caller, request: RequestFields) -> Fields:
        """An order that is not checked here, behind those that its client gave before."""
        async with self._run.moves.turns.turn(caller.number, name):
            pass
        return await verb(caller, request)

    async def _in_turn(self, name: str, verb: Verb, caller: Caller, request: RequestFields) -> Fields:
        """An order that is checked before it is sent; those that its client gives later wait for that."""
        async with self._run.moves.turns.turn(caller.number, name):
            return await verb(caller, request)

    def notice(self, event: OrderRefused) -> None:
        """Keep why the devices of a robot are not cleared, which answers no order."""
        if not event.answers and not event.stronger:
            self._refusals[event.robot] = event.message

    async def _acquire(self, caller: Caller, request: RequestFields) -> Fields:
        """Take the lease; what the client before it moved holds."""
        timeout_s = request.number("timeout_s", TIMEOUT_S, MIN_TIMEOUT_S, MAX_TIMEOUT_S)
        takeover, unless_stopped = request.flag("takeover"), request.flag("unless_stopped")
        request.end()
        before = self._run.lease.acquire(
            caller.number, caller.name, time.monotonic(), timeout_s, takeover, caller.by, unless_stopped
        )
        if before is not None:
            self._end_work_of(before, f"{client_label(caller.name, caller.by)} took over")
        return {"timeout_s": timeout_s, "from": None if before is None else before.name}

    def _end_work_of(self, holder: LeaseHolder, message: str) -> None:
        """End what a client that lost the lease moves; ``message`` names who took over."""
        if holder.client == INPUT_CLIENT:
            self._run.control.detach_input()
        else:
            self._run.control.send(Hold())
            self._run.notify(holder.client, {"event": "lease-lost", "message": message})
        self._run.moves.stop(message)
        log.warning("%s from %r; holding", message, holder.name)

    async def _release(self, caller: Caller, request: RequestFields) -> Fields:
        """Give the lease back; robots on a stream of rows hold, one on its way to a point goes on."""
        request.end()
        if self._run.moves.along_rows(caller.number):
            self._run.control.send(Hold())
            self._run.moves.abort("the lease was released")
        return {"released": self._run.lease.release(caller.number)}

    async def _resume(self, caller: Caller, request: RequestFields) -> Fields:
        return await self._go_on(caller, request, Resume)

    async def _recover(self, caller: Caller, request: RequestFields) -> Fields:
        return await self._go_on(caller, request, Recover)

    async def _go_on(self, caller: Caller, request: RequestFields, order: type[Resume | Recover]) -> Fields:
        """Let robots go on; that lifts the stops which stood before, unless it is refused."""
        robots, after_stop = self._run.robots_of(request), request.flag("after_stop")
        request.end()
        lease = self._run.lease
        stops = lease.allow(caller.number, time.monotonic(), after_stop)
        if order is Resume:
            self._refuse_faults(robots)
        result = await self._run.confirmed(self._run.pending.send([order(robots)]), robots)
        for client, stop in stops.items():
            lease.end_stop(client, stop)
        return result

    def _refuse_faults(self, robots: tuple[str, ...] | None) -> None:
        """Refuse to resume a named robot in FAULT; without names, one robot that can resume is enough."""
        faults = self._run.view.faults(self._run.control.newest(), robots)
        if faults and (robots is not None or len(faults) == len(self._run.view.configs)):
            found = "; ".join(
                f"{name}: fault {fault['number']} {fault['name']}, {fault['what']}"
                for name, fault in faults.items()
            )
            raise RemoteError(Code.FAULT, f"{found}; clear-fault first", faults)

    async def _clear_fault(self, caller: Caller, request: RequestFields) -> Fields:
        """Ask the devices of faulty robots to clear, and wait until those have left FAULT or refused."""
        robots = self._run.robots_of(request)
        request.end()
        self._run.lease.check_free(caller.number, time.monotonic())
        faulty = tuple(self._run.view.faults(self._run.control.newest(), robots))
        refused: dict[str, str] = {}
        for name in faulty:
            self._refusals.pop(name, None)
        if faulty:
            pending = self._run.pending
            refused = (await pending.confirmed(pending.send([ClearFault(faulty)]))).refused
        why = ChainMap(refused, self._refusals)
        left, record = await self._still_faulty(faulty, why)
        if left:
            message = "; ".join(
                why.get(name, f"{name}: not cleared, its devices have not answered") for name in left
            )
            raise RemoteError(Code.FAULT, message, self._run.view.faults(record, left))
        return {"cleared": sorted(faulty), "robots": self._run.states(robots, record)}

    async def _still_faulty(self, faulty: tuple[str, ...], why: Mapping[str, str]) -> _StillFaulty:
        """Of robots whose devices were asked to clear, those in FAULT once all the others have left it.

        Waits until each left it or refused, and no longer than `CONFIRM_TIMEOUT_S`; with the record that
        shows it.
        """
        left = set(faulty)
        deadline_s = time.monotonic() + CONFIRM_TIMEOUT_S
        while True:
            record = self._run.control.newest()
            left = {name for name in left if self._run.view.mode(name, record) is Mode.FAULT}
            if not left or left <= why.keys() or time.monotonic() > deadline_s:
                return _StillFaulty(tuple(sorted(left)), record)
            await asyncio.sleep(_LOOK_S)

    async def _move(self, caller: Caller, request: RequestFields) -> Fields:
        """Begin a move to a point, or along rows that follow; a free lease is taken for it."""
        target, columns = request.mapping("target"), request.names("columns")
        force_n = request.given_number("until_force_n", 0.0, MAX_FORCE_N)
        nearest = request.flag("nearest")
        request.end()
        if force_n == 0.0:
            message = "until_force_n: a force above 0 N is expected; leave it out to move without one"
            raise RemoteError(Code.BAD_REQUEST, message)
        if force_n is not None and target is None:
            raise RemoteError(Code.BAD_REQUEST, "until_force_n belongs to a target, not to columns")
        if (target is None) == (columns is None):
            message = "move takes a target (a point) or columns (a stream of rows), one of them"
            raise RemoteError(Code.BAD_REQUEST, message)
        lease, moves = self._run.lease, self._run.moves
        had_lease = lease.held_by(caller.number)
        own_stop = lease.require(caller.number, caller.name, time.monotonic(), caller.by)
        try:
            if target is not None:
                begun = await moves.point(caller.number, target, caller.notify, force_n)
            else:
                begun = await moves.begin(caller.number, columns or (), caller.notify, nearest)
        except RemoteError:
            if not had_lease:  # a refused move takes no lease
                lease.release(caller.number)
            raise
        lease.end_stop(caller.number, own_stop)
        return begun

    async def _grip(self, caller: Caller, request: RequestFields) -> Fields:
        """Limit the effort of robots to a share of what their devices may do."""
        robots, share = self._run.robots_of(request), request.given_number("share", 0.0, 1.0)
        request.end()
        if share is None:
            raise RemoteError(Code.BAD_REQUEST, "share: a number from 0 to 1 is expected")
        self._run.lease.check_free(caller.number, time.monotonic())
        result = await self._run.confirmed(self._run.pending.send([Grip(share, robots)]), robots)
        return {**result, "share": share}

    async def _rows(self, caller: Caller, request: RequestFields) -> Fields:
        """Rows of a move along rows."""
        number, rows = _move_number(request), request.rows("rows")
        request.end()
        return await self._run.moves.rows(caller.number, number, rows)

    async def _end(self, caller: Caller, request: RequestFields) -> Fields:
        """No further rows follow; ``hold_at_start``: a trajectory waits for `_start`."""
        number, hold = _move_number(request), request.flag("hold_at_start")
        request.end()
        return await self._run.moves.end(caller.number, number, hold)

    async def _start(self, caller: Caller, request: RequestFields) -> Fields:
        """Start a trajectory that waits, now or at a time of the monotonic clock."""
        number, at_s = _move_number(request), request.given_number("at_s", 0.0, _MAX_TIME_S)
        request.end()
        return await self._run.moves.start(caller.number, number, at_s)


def _move_number(request: RequestFields) -> int:
    return int(request.number("move", 0, 0, _MAX_NUMBER))
