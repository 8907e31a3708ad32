"""Gotos of moves: accepted by the control process, then ended robot by robot."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from contid.control.daemon.interfaces import RunControl
from contid.control.engine.events.robots import GotoEnded, SqueezeChanged
from contid.control.engine.messages import Goto, Hold, Message
from contid.remote.protocol.wire import Fields, RemoteError
from contid.remote.server.move import Move
from contid.remote.server.pending_orders import OrderResult, PendingOrders
from contid.remote.server.telemetry_view import TelemetryView
from contid.targets import Target


class _Begun(NamedTuple):
    """A goto of a move, and the result of its order."""

    move: Move
    result: asyncio.Future[OrderResult]

    def refused(self, robot: str) -> bool:
        """True once the control process has refused it, so that no end of it will come."""
        return self.result.done() and not self.result.cancelled() and robot in self.result.result().refused

    def obeyed_before(self, tick: int) -> bool:
        """True once the control process is known to have obeyed it before a tick."""
        return self.result.done() and not self.result.cancelled() and self.result.result().tick < tick


class Gotos:
    """The gotos that have not ended, by robot, in the order in which they were sent and will end.

    A goto ends in the tick that obeys the next one at the latest. Where the next one was obeyed before the
    tick of an end, the end of the one before was lost, as in a ring that was overrun.
    """

    def __init__(self, control: RunControl, view: TelemetryView, pending: PendingOrders) -> None:
        self._control = control
        self._view = view
        self._pending = pending
        self._begun: dict[str, deque[_Begun]] = {name: deque() for name in view.configs}

    async def begin(
        self,
        move: Move,
        targets: Mapping[str, Target],
        before: Iterable[Message] = (),
        until_force_n: float | None = None,
    ) -> Fields:
        """Send the gotos of a move; returns when the control process has accepted them.

        Where one robot refuses, the others hold.

        Raises:
            RemoteError: a robot refused, or nothing was confirmed in time.
        """
        gotos = [Goto(name, target, until_force_n) for name, target in targets.items()]
        result = self._pending.send([*before, *gotos])
        move.waiting.update(targets)
        for name in targets:
            self._begun[name].append(_Begun(move, result))
        try:
            outcome = await self._pending.confirmed(result)
            if outcome.refused:
                raise outcome.refusal(self._view.faults(self._control.newest(), tuple(targets)))
        except RemoteError:
            move.refused = True
            going = [name for name in targets if self._newest(name) is move]
            if result.done() and going:
                self._control.send(Hold(tuple(going)))
            raise
        return {"move": move.number, "tick": outcome.tick}

    def ended(self, event: GotoEnded) -> None:
        """A goto ended; its move ends with the last one."""
        begun = self._of(event.robot)
        while len(begun) > 1 and begun[1].obeyed_before(event.tick):
            self._end(begun.popleft().move, event.robot, "its end was not seen")
        if begun:
            self._end(begun.popleft().move, event.robot, event.message, event.arrived)

    def _end(self, move: Move, robot: str, message: str, arrived: bool = False) -> None:
        """The goto of a robot of a move ended."""
        move.waiting.discard(robot)
        if not arrived:
            move.failed.add(robot)
            move.reasons[robot] = message or move.reasons.get(robot, "")
        if not move.waiting and not move.refused:
            faults = self._view.faults(self._control.newest(), tuple(move.failed))
            message = f"{', '.join(sorted(move.failed))} did not arrive" if move.failed else ""
            why = [f"{name}: {move.reasons[name]}" for name in sorted(move.failed) if move.reasons[name]]
            move.end(not move.failed, "; ".join([message, *why]), faults)

    def squeezed(self, event: SqueezeChanged) -> None:
        """Keep why a move until a force ended, for its end."""
        if begun := self._of(event.robot):
            begun[0].move.reasons[event.robot] = event.message

    def _of(self, robot: str) -> deque[_Begun]:
        """The gotos of a robot that were not refused."""
        self._begun[robot] = deque(each for each in self._begun.get(robot, ()) if not each.refused(robot))
        return self._begun[robot]

    def _newest(self, robot: str) -> Move | None:
        """The move of the newest goto of a robot, None for none that may still end."""
        begun = self._begun[robot]
        return begun[-1].move if begun and not begun[-1].refused(robot) else None
