"""Where the time of a cycle goes, and the robot whose tick runs: measured, never an input of a tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from contid.control.tick.faults import Fault


class UnansweredError(BaseException):
    """Raised where the model of a robot does not answer; no model may catch it as its own error.

    A replay has it from an event, and asks the model as little.

    Attributes:
        fault: of the robot.
    """

    def __init__(self, message: str, fault: Fault = Fault.MODEL_TOO_SLOW) -> None:
        super().__init__(message)
        self.fault = fault


class TickCosts:
    """The times of the newest cycle, on the clock of the buses [s].

    Attributes:
        now: the clock.
        began_s: when the cycle began.
        ended_s: when it ended.
        robots_s: duration of the tick of each robot.
        buses_s: duration of the exchange of each bus without a worker.
        waited_s: time spent waiting for workers, up to their deadline.
        running: index of the robot whose tick runs, -1 for none.
        begun: ticks of robots begun so far.
        watch: called with True before what may ask models, with False after it; one part may be in another.
        watched: the context of what may ask models: one that takes too long is interrupted.
        robot_at_work: one number that other processes see: of the robot that computes or did last, from 1 on,
            and 0 after the ticks of all robots.
    """

    def __init__(self, now: Callable[[], float], robots: int, buses: Sequence[str]) -> None:
        self.now = now
        self.began_s = self.ended_s = self.waited_s = 0.0
        self.robots_s = [0.0] * robots
        self.buses_s = dict.fromkeys(buses, 0.0)
        self.running = -1
        self.begun = 0
        self.watch: Callable[[bool], None] = lambda begins: None
        self.watched = _Watched(self)
        self.robot_at_work: memoryview[int] | list[int] = [0]

    def begin(self, index: int) -> None:
        """The tick of a robot begins."""
        self.begun += 1
        self.running = index
        self.robot_at_work[0] = index + 1


class _Watched:
    """See `TickCosts.watched`; one for all ticks, as a generator each costs more than it watches."""

    def __init__(self, costs: TickCosts) -> None:
        self._costs = costs

    def __enter__(self) -> None:
        self._costs.watch(True)

    def __exit__(self, *error: object) -> None:
        self._costs.watch(False)
