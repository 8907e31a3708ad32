"""A goto ends when the measured robot is at its target, or after the time that its axes have to settle."""

from __future__ import annotations

from collections.abc import Sequence

from contid.control.engine.cycle import Sink
from contid.control.engine.events.robots import GotoEnded
from contid.control.engine.robots import Robots
from contid.control.engine.stages import TickStage
from contid.control.engine.watch.body_watch import BodyWatch
from contid.control.engine.watch.settling import has_arrived
from contid.control.tick.supervisor import Mode


class Arrivals(TickStage):
    """The gotos whose commands are at their targets and whose robots may not be there yet."""

    def __init__(self, robots: Robots, body_watch: BodyWatch, sink: Sink) -> None:
        self.robots: Sequence[int] = range(len(robots.configs))
        self._robots = robots
        self._body_watch = body_watch
        self._sink = sink
        #: By index of the robot, until when it may arrive; None until the first look.
        self._waiting: dict[int, float | None] = {}

    def commanded(self, index: int) -> None:
        """The command of a robot is at the target of its goto."""
        self._waiting[index] = None

    def replaced(self, index: int, number: int) -> None:
        """Before a tick a robot goes elsewhere: the goto that still waits ends before the new one can."""
        if index in self._waiting:
            self._end(index, number, self._arrived(index))

    def settle(self, now_s: float) -> None:
        """See `TickStage.settle`: ends the gotos whose robots arrived, left, or had their time."""
        for index, until_s in list(self._waiting.items()):
            state = self._robots.states[index]
            until_s = self._waiting[index] = until_s or now_s + self._body_watch.settlings[index].settle_s
            arrived = self._arrived(index)
            if arrived or now_s >= until_s or state.mode is not Mode.HOLD or state.goto is not None:
                self._end(index, self._robots.tick, arrived)

    def _arrived(self, index: int) -> bool:
        places = self._body_watch.places(index)
        return bool(places) and has_arrived(places) and self._robots.states[index].mode is not Mode.FAULT

    def _end(self, index: int, number: int, arrived: bool) -> None:
        del self._waiting[index]
        far = "; ".join(str(place) for place in self._body_watch.places(index) if not place.arrived)
        name = self._robots.configs[index].name
        self._sink.event(GotoEnded(robot=name, arrived=arrived, tick=number, message=far))
