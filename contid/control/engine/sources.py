"""Sources of targets: a timed trajectory, or a live stream."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final, Protocol, TypeAlias, TypeVar

from contid.control.engine.live.target_follower import TargetFollower
from contid.control.tick.config import RobotConfig
from contid.control.tick.soft_start import ease_ticks, fitted, played
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.targets import Target
from contid.trajectory.timed import Trajectory

#: How long after the last row the limiter may still need to bring a robot onto it.
SETTLE_S: Final = 5.0
T = TypeVar("T")


class Ask(Protocol):
    """Asks the follower of a robot what may need its model: `contid.control.engine.robots.Robots.ask`."""

    def __call__(
        self, index: int, now_s: float, question: Callable[..., T], /, *arguments: object
    ) -> T | None:
        """The answer, None where the model fails."""


class Timed:
    """A timed trajectory.

    Its clock starts when every robot that follows it has arrived at the first row (a robot in FAULT, or held
    by an order, is not waited for), and counts ticks: time ``start + n/rate``, so a row written at a tick is
    met exactly. Skipped ticks are not counted, so robots stay on the path. Starts and ends at speed are
    eased (`contid.control.tick.soft_start`). Once every robot that follows it was stopped, one by one, by
    name or by a fault, it stands until one follows again, where a client may let them go on.

    Attributes:
        waits: it stays at its first row.
        within_reach: its targets were found within reach.
        time_s: time in the trajectory [s].
        finished: it has ended, and every robot has reached its last target.
    """

    def __init__(
        self, trajectory: Trajectory, rate_hz: float, configs: Sequence[RobotConfig], waits: bool = False
    ) -> None:
        self._trajectory = trajectory
        self._rate_hz = rate_hz
        self._configs = tuple(configs)
        followers = trajectory.targets_of_row(0)
        self._robots = [index for index, config in enumerate(configs) if config.name in followers]
        self._length = (trajectory.end_s - trajectory.start_s) * rate_hz
        self._origin: int | None = None
        self._base = 0.0  # ticks of the trajectory played before the last pause
        # Known before the first tick: with many robots this takes longer than a tick may.
        self._start_lead = ease_ticks(self._configs, trajectory, trajectory.start_s, ahead=True)
        self._end_tail = ease_ticks(self._configs, trajectory, trajectory.end_s, ahead=False)
        self._lead = self._tail = 0
        self._slowed = 0.0  # ticks by which it is later since its clock started, because a body was behind
        self._paused = False
        self._waits_for_orders = all(config.motion_rules > 9 for config in self._configs)
        self.waits = waits
        self.within_reach = trajectory.within_reach
        self._ended_at: int | None = None
        self.time_s = trajectory.start_s
        self.finished = False

    def targets(self, tick: int) -> Mapping[str, Target | None]:
        """Targets by robot at the time of this tick, in the world frame."""
        trajectory = self._trajectory
        position = self._position(tick)
        if self._origin is not None and position >= self._length and self._ended_at is None:
            self._ended_at = tick
        time_s = trajectory.start_s + position / self._rate_hz
        if position >= self._length:
            time_s = trajectory.end_s
        self.time_s = time_s
        return trajectory.targets_at(time_s)

    def watch(self, tick: int, states: Sequence[RobotState], attended: bool = False) -> None:
        """After a tick: start the clock when every robot has arrived; detect the end.

        ``attended``: a client may let robots go on that were stopped.
        """
        followers = [states[index] for index in self._robots if states[index].follow]
        if attended and self._waits_for_orders and not followers:
            self._base, self._origin, self._ended_at = self._position(tick), None, None
            return
        if self._waits_for_orders and len(followers) == len(self._robots):
            self._paused = False  # each was resumed by its name
        if self._ended_at is not None:
            still = all(state.command == state.reference for state in followers)
            self.finished = still or tick - self._ended_at > SETTLE_S * self._rate_hz
        elif self._origin is None and not self._paused and not self.waits and followers:
            arrived = all(state.mode is Mode.RUN for state in followers)
            if arrived:
                self._begin(tick)

    def at_start(self, states: Sequence[RobotState]) -> bool:
        """True when it waits, and every robot has arrived at the first row."""
        robots = [states[index] for index in self._robots]
        return self.waits and not self._paused and all(s.follow and s.mode is Mode.RUN for s in robots)

    def pause(self, tick: int) -> None:
        """Stop the clock of the trajectory at the time reached."""
        self._base = self._position(tick)
        self._origin, self._paused = None, True

    def resume(self) -> None:
        """Go on as soon as the robots are back at the time reached."""
        self._paused = False

    def slow(self, ticks: float) -> None:
        """Let the clock of the trajectory, if it runs, be later by a part of a tick from now on."""
        if self._origin is not None:
            self._slowed += ticks

    def _position(self, tick: int) -> float:
        """Ticks of the trajectory played by now."""
        if self._origin is None:
            return self._base
        since = tick - self._origin - self._slowed
        return self._base + played(since, self._length - self._base, self._lead, self._tail)

    def _begin(self, tick: int) -> None:
        trajectory, left = self._trajectory, self._length - self._base
        lead = self._start_lead
        if self._base > 0.0:
            now_s = trajectory.start_s + self._base / self._rate_hz
            lead = ease_ticks(self._configs, trajectory, now_s, ahead=True)
        self._lead, self._tail = fitted(lead, left), fitted(self._end_tail, left)
        self._origin, self._slowed = tick, 0.0


class Live:
    """A live stream: every robot follows its rows (`contid.control.engine.live.target_follower`).

    Attributes:
        time_s: None, as a stream has no times.
        finished: it has ended, and every robot has reached its last target.
    """

    def __init__(self, configs: Sequence[RobotConfig]) -> None:
        self._followers = [TargetFollower(config) for config in configs]
        self._names = [config.name for config in configs]
        self._ended = self._paused = False
        self.time_s = None
        self.finished = False

    @property
    def delay_s(self) -> float:
        """How long after it was meant a row is followed [s]: the greatest of the robots."""
        return max([follower.delay_s for follower in self._followers], default=0.0)

    def put(
        self,
        targets: Mapping[str, Target | None],
        now_s: float,
        skipped_s: float,
        states: Sequence[RobotState],
        ask: Ask,
    ) -> None:
        """A new row; robots it does not name keep their target; ``skipped_s``: of `TargetFollower.put`."""
        for name, target in targets.items():
            index = self._names.index(name)
            ask(index, now_s, self._followers[index].put, target, now_s, states[index], skipped_s)

    def end(self) -> None:
        """No further row will come."""
        self._ended = True
        for follower in self._followers:
            follower.end()

    def targets(
        self, now_s: float, skipped_s: float, states: Sequence[RobotState], ask: Ask
    ) -> Mapping[str, Target | None]:
        """Targets by robot at a tick, in the world frame; none while the stream is paused."""
        given = {}
        for index, follower in enumerate(self._followers):
            if follower.row is not None:
                given[self._names[index]] = ask(
                    index, now_s, follower.target, now_s, states[index], skipped_s
                )
        return {} if self._paused else given

    def watch(self, tick: int, states: Sequence[RobotState], attended: bool = False) -> None:
        """At the end of the stream, wait until the last row is reached."""
        if self._ended:
            self.finished = not any(
                state.mode in (Mode.CONNECTING, Mode.READY, Mode.ARMING, Mode.APPROACH)
                or (state.mode is Mode.RUN and not (follower.resting and state.command == state.reference))
                for follower, state in zip(self._followers, states, strict=True)
                if follower.row is not None and state.follow
            )

    def pause(self, tick: int) -> None:
        """Robots hold until `resume`."""
        self._paused = True

    def resume(self) -> None:
        """Follow the newest row again."""
        self._paused = False


#: Targets by robot at a tick, in the world frame; a robot without one holds.
Source: TypeAlias = Timed | Live
