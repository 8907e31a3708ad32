"""Gotos of moves: accepted by the control process, then ended robot by robot."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping

from contid.control.daemon.interfaces import RunControl
from contid.control.engine.events.robots import GotoEnded, SqueezeChanged
from contid.control.engine.messages import Goto, Message
from contid.remote.protocol.wire import Fields
from contid.remote.server.move import Move
from contid.remote.server.pending_orders import PendingOrders
from contid.remote.server.telemetry_view import TelemetryView
from contid.targets import Target


class Gotos:
    """The gotos that have not ended, by robot."""

    def __init__(self, control: RunControl, view: TelemetryView, pending: PendingOrders) -> None:
        self._control = control
        self._view = view
        self._pending = pending
        self._moves: dict[str, deque[Move]] = {name: deque() for name in view.configs}
        #: Why the newest move of a robot until a force ended.
        self._squeezed: dict[str, str] = {}

    async def begin(
        self,
        move: Move,
        targets: Mapping[str, Target],
        before: Iterable[Message] = (),
        until_force_n: float | None = None,
    ) -> Fields:
        """Send the gotos of a move; returns when the control process has accepted them.

        Raises:
            RemoteError: a robot refused.
        """
        for name in targets:
            move.waiting.add(name)
            self._moves[name].append(move)
            self._squeezed.pop(name, None)
        gotos = [Goto(name, target, until_force_n) for name, target in targets.items()]
        outcome = await self._pending.confirmed(self._pending.send([*before, *gotos]))
        if outcome.refused:
            for name in outcome.refused:
                move.waiting.discard(name)
                if move in self._moves.get(name, ()):
                    self._moves[name].remove(move)
            raise outcome.refusal(self._view.faults(self._control.newest(), tuple(targets)))
        return {"move": move.number, "tick": outcome.tick}

    def ended(self, event: GotoEnded) -> None:
        """A goto ended; its move ends with the last one."""
        robot = event.robot
        if not self._moves.get(robot):
            return
        move = self._moves[robot].popleft()
        move.waiting.discard(robot)
        if not event.arrived:
            move.failed.add(robot)
            if event.message:
                self._squeezed[robot] = event.message
        if not move.waiting:
            faults = self._view.faults(self._control.newest(), tuple(move.failed))
            message = f"{', '.join(sorted(move.failed))} did not arrive" if move.failed else ""
            why = [f"{name}: {self._squeezed.pop(name)}" for name in sorted(move.failed & {*self._squeezed})]
            move.end(not move.failed, "; ".join([message, *why]), faults)

    def squeezed(self, event: SqueezeChanged) -> None:
        """Keep why a move until a force ended, for its end."""
        self._squeezed[event.robot] = event.message
