"""What one robot follows of a live stream: a curve through its rows, or a straight line to a row that jumped.

* Rows become a smooth curve (`row_curve`), played by a clock that is learnt from their arrival (`row_clock`).
* A row far from where the stream stood, or one without a clock, is the target at once. From rest the tip goes
  to it on a straight line (`tip_line`); rows that go on meanwhile end the line.
* Where the axes cannot be on any of this, they come to it as fast as their limits allow
  (`contid.control.tick.jerk_guard`).
"""

from __future__ import annotations

from typing import Final

from contid.control.engine.live.row_clock import RowClock
from contid.control.engine.live.row_curve import RowCurve, Vector
from contid.control.engine.live.target_vector import Kind, kind_of, target_of, vector_of
from contid.control.engine.live.tip_line import TipLine, tip_line
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import WITHOUT_MODEL
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.targets import Target

#: How long rows are expected before the stream counts as stopped [s]; it is one row at least.
EXPECTED_S: Final = 0.05
#: How many rows are expected at most.
EXPECTED_ROWS: Final = 10.0
#: Share of the limits of acceleration and jerk that a stop on the last row uses.
_STOP_SHARE: Final = 0.35
#: Axes slower than this share of their limit stop as if they were as fast.
_SLOW: Final = 0.02
#: Rate of the phase, in rows per period, below which steps of the axes are no measure of rows.
_LEAST_RATE: Final = 0.25
#: Coordinates that differ by less are the same.
_SAME: Final = 1e-9
#: Share of the limits that a curve from rest may need; more is a jump.
_SHARE: Final = 0.9
#: Square of the distance from where a row was expected that is clearly less than another.
_CLEARLY: Final = 0.25
#: Rows that can be lost in a row.
_LOST: Final = 5


class TargetFollower:
    """The target of one robot at every tick."""

    def __init__(self, config: RobotConfig) -> None:
        self._config = config
        self._clock = RowClock(config.period_s, config.motion_rules)
        self._curve: RowCurve | None = None
        #: The newest row; a robot without one holds.
        self.row: Target | None = None
        self._kind: Kind = ()
        self._given: Target | None = None
        self._line: TipLine | None = None
        self._line_s = 0.0
        self._jumped = False
        self._ended = False

    @property
    def delay_s(self) -> float:
        """How long after it was meant a row is followed [s]; 0 for rows without a clock."""
        return self._clock.delay_s

    @property
    def resting(self) -> bool:
        """True where the newest row is the target itself."""
        return self._line is None and (self._curve is None or self._curve.rests(self._clock.phase))

    def put(self, row: Target | None, now_s: float, state: RobotState, skipped_s: float = 0.0) -> None:
        """A row arrived; None holds the robot.

        Args:
            row: in the world frame.
            now_s: the time of the robot, which counts the ticks that ran.
            state: of the robot before this tick.
            skipped_s: time of the ticks that were skipped so far. Rows come by a clock that went on.
        """
        self.row = row
        if row is None:
            self._curve = self._line = None
            return
        clock, curve, vector = self._clock, self._curve, vector_of(row)
        skipped_s = self._counted(skipped_s)
        clock_s = clock.came_s(now_s + skipped_s, skipped_s)
        before, self._kind = self._kind, kind_of(row)
        if curve is None or before != self._kind:
            clock.arrived(clock_s)
            self._jump(vector, now_s, state)
            return
        rested = curve.rests(clock.phase)
        stood = rested and not self._jumped
        clock.arrived(clock_s, self._rows_on(curve, vector, clock_s))
        # On its way a curve without a clock would stand; a row that repeats the last one is its end then.
        goes_on = rested or clock.period_s or self._config.motion_rules < 9
        if vector == curve.last and goes_on:
            curve.add(clock.newest, vector, clock.period_s)
            self._jumped = False
        elif not clock.period_s or (stood and not self._smooth(state, row)):
            self._jump(vector, now_s, state)
        else:
            curve.add(clock.newest, vector, clock.period_s)
            self._jumped = False

    def end(self) -> None:
        """No further row will come."""
        self._ended = True

    def target(self, now_s: float, state: RobotState, skipped_s: float = 0.0) -> Target | None:
        """The target of a tick; times as of `put`."""
        row = self.row
        if row is None or self._curve is None:
            self._given = None
            return row
        skipped_s = self._counted(skipped_s)
        self._clock.skip(skipped_s)
        phase = self._phase(self._curve, now_s, state, now_s + skipped_s)
        curve = self._curve  # another one where it came to rest
        rests = curve.rests(phase)
        if self._line is not None:
            since_s = now_s - self._line_s
            follows = state.mode is Mode.RUN and state.follow
            if rests and follows and since_s < self._line.duration_s:
                self._given = self._line.at(since_s)
                return self._given
            self._line = None
        self._given = row if rests else target_of(curve.at(phase), row)
        return self._given

    def _counted(self, skipped_s: float) -> float:
        """What counts of the time of skipped ticks in the clock by which rows come."""
        return skipped_s if self._config.motion_rules > 8 else 0.0

    def _phase(self, curve: RowCurve, now_s: float, state: RobotState, clock_s: float) -> float:
        """Which row is played; where no row comes, the phase comes to rest on the last one."""
        clock = self._clock
        if not clock.period_s or curve.rests(clock.phase):
            return clock.play(clock_s)
        if clock.stop is None or clock.resumes:
            most = EXPECTED_S / clock.period_s
            if self._config.motion_rules > 3:  # a period that is learnt too short leads no farther
                most = min(most, EXPECTED_ROWS)
            if not self._ended and clock.missing() <= max(1.0, most):
                return clock.play(clock_s)
            if clock.stop is None:  # else rows that came end in a stop again, within the limits of the first
                clock.stop_rates = self._phase_rates(state)
        if clock.come_to_rest(forward=self._config.motion_rules > 1):
            off = max(abs(a - b) for a, b in zip(curve.at(clock.phase), curve.last, strict=True))
            if off > _SAME:
                self._jump(curve.last, now_s, state)
            self._curve = RowCurve(clock.newest + 2, curve.last, self._config.motion_rules)
        return clock.phase

    def _phase_rates(self, state: RobotState) -> tuple[float, float]:
        """Acceleration and jerk of the phase [1/s^2, 1/s^3] that the axes allow at their present motion."""
        config, clock = self._config, self._clock
        least = _LEAST_RATE if config.motion_rules > 1 else 1e-3
        rows = max(abs(clock.rate_per_s), least / clock.period_s) * config.period_s
        acceleration = jerk = float("inf")
        steps = state.increments or (0.0,) * len(config.velocity)
        for step, v, a, j in zip(steps, config.velocity, config.acceleration, config.jerk, strict=True):
            per_row = max(abs(step) / rows, _SLOW * v * clock.period_s)
            acceleration = min(acceleration, _STOP_SHARE * a / per_row)
            jerk = min(jerk, _STOP_SHARE * j / per_row)
        return acceleration, jerk

    def _jump(self, vector: Vector, now_s: float, state: RobotState) -> None:
        """The row is the target at once; from rest by a straight line."""
        self._curve = RowCurve(self._clock.newest, vector, self._config.motion_rules)
        self._jumped = True
        start, row, self._line = self._given, self.row, None
        rests = state.command == state.reference and not any(state.increments)
        if start is None or row is None or not (rests and state.follow and state.mode is Mode.RUN):
            return
        if kind_of(start) == kind_of(row):
            self._line = tip_line(self._config, start, row, state.command)
            self._line_s = now_s - self._config.period_s

    def _smooth(self, state: RobotState, row: Target) -> bool:
        """True when the limits of the axes allow the curve from rest to a row."""
        config, period_s = self._config, self._clock.period_s
        if not state.command or state.fault in WITHOUT_MODEL:
            return True
        answer = config.model.inverse(config.frame.target_in_base(row), state.command).actuation
        limits = zip(answer, state.command, config.velocity, config.acceleration, config.jerk, strict=True)
        return all(
            abs(new - old) <= _SHARE * min(v * period_s, a * period_s**2, 0.5 * j * period_s**3)
            for new, old, v, a, j in limits
        )

    def _rows_on(self, curve: RowCurve, vector: Vector, now_s: float) -> int:
        """How many rows after the newest one this is, where rows may have been lost.

        A row that comes later than half a period is either late, or those before it were lost. It is the one
        that goes on from the last two rows better; where both do, as on a slow path, its time counts.
        """
        late = min(int(self._clock.expected(now_s) + 0.5), _LOST)
        if late < 2:
            return 1
        step = [b - a for a, b in zip(curve.before, curve.last, strict=True)]
        off = [
            sum([(x - a - k * d) ** 2 for x, a, d in zip(vector, curve.last, step, strict=True)])
            for k in range(1, late + 1)
        ]
        best = off.index(min(off))
        return 1 if off[0] < _CLEARLY * off[late - 1] else best + 1 if off[best] < _CLEARLY * off[0] else late
