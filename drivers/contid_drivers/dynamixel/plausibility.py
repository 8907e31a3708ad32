"""Readings that a healthy servo cannot give: a jump, a shaft that does not follow, a slack tendon."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

#: No X-series servo turns faster (XL330-M077: 383 rpm at 5 V).
SPEED_MAX_RAD_S: Final = 500.0 * math.tau / 60.0
#: A motion between two readings that only comes after a gap, or a lost turn.
FAR_RAD: Final = math.radians(45.0)
#: Noise of the time of a measurement, as an angle.
JUMP_SLACK_RAD: Final = 0.5
#: After a longer gap a turn is within reach of the speed.
JUMP_WINDOW_S: Final = 0.1
#: Share of the current limit at which a servo counts as pushing.
PUSHING: Final = 0.5
#: Below this speed it stands still.
STILL_RAD_S: Final = math.radians(3.0)
#: An error that shrinks by this share of its limit is progress.
PROGRESS: Final = 0.1
#: A tendon that carried this many times its least current just before has snapped.
SNAPPED: Final = 3.0


def has_jumped(moved_rad: float, elapsed_s: float) -> bool:
    """Whether a position changed faster than a servo turns."""
    if elapsed_s > JUMP_WINDOW_S:
        return False
    return abs(moved_rad) > SPEED_MAX_RAD_S * elapsed_s + JUMP_SLACK_RAD


@dataclass(slots=True)
class FollowingError:
    """Detects a servo that stays behind its goal without progress, while it stands still or pushes hard.

    Attributes:
        limit_rad: error that is normal; infinite switches the detection off.
        time_s: time for which a larger one is normal.
        since: start of the lack of progress [s], None without one.
        best_rad: smallest error since then.
    """

    limit_rad: float
    time_s: float
    since: float | None = None
    best_rad: float = math.inf

    def is_exceeded(self, error_rad: float, velocity_rad_s: float, load: float | None, now: float) -> bool:
        """Judge one measurement.

        Args:
            error_rad: goal minus position.
            velocity_rad_s: measured.
            load: current over its limit, None for a servo without current registers.
            now: time of the measurement [s].
        """
        error = abs(error_rad)
        pushing = load is not None and load >= PUSHING
        if error <= self.limit_rad or not (pushing or abs(velocity_rad_s) < STILL_RAD_S):
            self.since, self.best_rad = None, math.inf
            return False
        if self.since is None or error < self.best_rad - PROGRESS * self.limit_rad:
            self.since, self.best_rad = now, error
        return now - self.since >= self.time_s

    def clear(self) -> None:
        """Forget the past; for a new goal after arming."""
        self.since, self.best_rad = None, math.inf


@dataclass(slots=True)
class SlackTendon:
    """Detects a tendon that carries no tension although its spool does not pay it out.

    Attributes:
        winding: sense of rotation that winds in; 0 switches the detection off.
        least_a: current of a taut tendon [A].
        time_s: time for which less is normal.
        since: start of less [s], None without it.
        before_a: current before it [A].
    """

    winding: int
    least_a: float
    time_s: float
    since: float | None = None
    before_a: float = 0.0

    def is_exceeded(self, effort_a: float, velocity_rad_s: float, now: float) -> bool:
        """Judge one measurement: current [A], velocity [rad/s] and its time [s]."""
        carried_a = self.winding * effort_a
        if not self.winding or carried_a >= self.least_a or self.winding * velocity_rad_s < -STILL_RAD_S:
            self.since, self.before_a = None, max(carried_a, 0.0)
            return False
        if self.since is None:
            self.since = now
        return now - self.since >= self.time_s

    @property
    def snapped(self) -> bool:
        """Whether the tendon carried much just before it was slack."""
        return self.before_a >= SNAPPED * self.least_a

    def clear(self) -> None:
        """Forget the past; for a new goal after arming."""
        self.since, self.before_a = None, 0.0
