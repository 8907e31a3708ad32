"""Orders that move, or let robots move again: they need the lease, which a stop by another client revokes."""

from __future__ import annotations

import asyncio
import logging
import time
from typing import Final

from contid.control.engine.events.robots import MarkReached, OrderRefused
from contid.control.engine.messages import ClearFault, Grip, Hold, Recover, Resume
from contid.control.tick.supervisor import Mode
from contid.remote.protocol.wire import Code, Fields, RemoteError, RequestFields
from contid.remote.server.lease import INPUT_CLIENT, MAX_TIMEOUT_S, MIN_TIMEOUT_S, TIMEOUT_S, client_label
from contid.remote.server.pending_orders import CONFIRM_TIMEOUT_S
from contid.remote.server.query_handler import Caller, Verb
from contid.remote.server.served_run import ServedRun

log = logging.getLogger(__name__)

#: Interval between two looks at robots that are being cleared.
POLL_S: Final = 0.02
#: Greatest force of a move until a force [N].
MAX_FORCE_N: Final = 1000.0


class MotionOrders:
    """The verbs of the lease, of arming and of moves."""

    def __init__(self, run: ServedRun) -> None:
        self._run = run
        #: Newest refusals that came with no order: those of devices that are to be cleared.
        self._refusals: dict[str, str] = {}
        self._in_order = False

    @property
    def verbs(self) -> dict[str, Verb]:
        """Method of each verb."""
        return {
            Resume.NAME: self._resume, ClearFault.NAME: self._clear_fault, Recover.NAME: self._recover,
            Grip.NAME: self._grip, "acquire": self._acquire, "release": self._release, "move": self._move,
            "rows": self._rows, "end": self._end, "start": self._start,
        }  # fmt: skip

    def notice(self, event: OrderRefused | MarkReached) -> None:
        """Keep why a robot is not cleared: what comes between two marks is the refusal of one order."""
        if isinstance(event, MarkReached):
            self._in_order = event.number % 2 == 1
        elif not self._in_order:
            self._refusals[event.robot] = event.message

    async def _acquire(self, caller: Caller, request: RequestFields) -> Fields:
        timeout_s = request.number("timeout_s", TIMEOUT_S, MIN_TIMEOUT_S, MAX_TIMEOUT_S)
        takeover, unless_stopped = request.flag("takeover"), request.flag("unless_stopped")
        request.end()
        before = self._run.lease.acquire(
            caller.number, caller.name, time.monotonic(), timeout_s, takeover, caller.by, unless_stopped
        )
        if before is not None:
            message = f"{client_label(caller.name, caller.by)} took over"
            if before.client == INPUT_CLIENT:
                self._run.control.detach_input()
            else:
                self._run.control.send(Hold())
                self._run.notify(before.client, {"event": "lease-lost", "message": message})
            self._run.moves.abort(message)
            log.warning("%s from %r; holding", message, before.name)
        return {"timeout_s": timeout_s, "from": None if before is None else before.name}

    async def _release(self, caller: Caller, request: RequestFields) -> Fields:
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
        faults = self._run.view.faults(self._run.control.newest(), robots) if order is Resume else {}
        # A robot that is named must not be in FAULT; without names, one robot that can resume is enough.
        if faults and (robots is not None or len(faults) == len(self._run.view.configs)):
            found = "; ".join(
                f"{name}: fault {f['number']} {f['name']}, {f['what']}" for name, f in faults.items()
            )
            raise RemoteError(Code.FAULT, f"{found}; clear-fault first", faults)
        result = await self._run.confirmed(self._run.pending.send([order(robots)]), robots)
        for client, stop in stops.items():
            lease.end_stop(client, stop)
        return result

    async def _clear_fault(self, caller: Caller, request: RequestFields) -> Fields:
        robots = self._run.robots_of(request)
        request.end()
        self._run.lease.check_free(caller.number, time.monotonic())
        record = self._run.control.newest()
        faulty = tuple(self._run.view.faults(record, robots))
        refused: dict[str, str] = {}
        if faulty:
            for name in faulty:
                self._refusals.pop(name, None)
            pending = self._run.pending
            refused = (await pending.confirmed(pending.send([ClearFault(faulty)]))).refused
        left = set(faulty)
        deadline_s = time.monotonic() + CONFIRM_TIMEOUT_S
        while left:
            record = self._run.control.newest()
            left = {name for name in left if self._run.view.mode(name, record) is Mode.FAULT}
            why = {**self._refusals, **refused}
            if not left or left <= why.keys() or time.monotonic() > deadline_s:
                break
            await asyncio.sleep(POLL_S)
        if left:
            message = "; ".join(
                why.get(name, f"{name}: not cleared, its devices have not answered") for name in sorted(left)
            )
            raise RemoteError(Code.FAULT, message, self._run.view.faults(record, tuple(sorted(left))))
        return {"cleared": sorted(faulty), "robots": self._run.states(robots, record)}

    async def _move(self, caller: Caller, request: RequestFields) -> Fields:
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
        held = self._run.lease.held_by(caller.number)
        own_stop = self._run.lease.require(caller.number, caller.name, time.monotonic(), caller.by)
        try:
            if target is not None:
                begun = await self._run.moves.point(caller.number, target, caller.notify, force_n)
            else:
                begun = await self._run.moves.begin(caller.number, columns or (), caller.notify, nearest)
        except RemoteError:
            if not held:
                self._run.lease.release(caller.number)
            raise
        self._run.lease.end_stop(caller.number, own_stop)
        return begun

    async def _grip(self, caller: Caller, request: RequestFields) -> Fields:
        robots, share = self._run.robots_of(request), request.given_number("share", 0.0, 1.0)
        request.end()
        if share is None:
            raise RemoteError(Code.BAD_REQUEST, "share: a number from 0 to 1 is expected")
        self._run.lease.check_free(caller.number, time.monotonic())
        return {
            **await self._run.confirmed(self._run.pending.send([Grip(share, robots)]), robots),
            "share": share,
        }

    async def _rows(self, caller: Caller, request: RequestFields) -> Fields:
        number, rows = int(request.number("move", 0, 0, 1e15)), request.rows("rows")
        request.end()
        return self._run.moves.rows(caller.number, number, rows)

    async def _end(self, caller: Caller, request: RequestFields) -> Fields:
        number, hold = int(request.number("move", 0, 0, 1e15)), request.flag("hold_at_start")
        request.end()
        return await self._run.moves.end(caller.number, number, hold)

    async def _start(self, caller: Caller, request: RequestFields) -> Fields:
        number, at_s = int(request.number("move", 0, 0, 1e15)), request.given_number("at_s", 0.0, 1e12)
        request.end()
        return await self._run.moves.start(caller.number, number, at_s)
