"""Statistics of a run in constant memory: lateness of the ticks, tip error of the robots."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from contid.control.tick.limits import FLAG_NAMES
from contid.units import m_to_mm


@dataclass(slots=True)
class Lateness:
    """Histogram of how late ticks started.

    Attributes:
        counts: ticks by lateness [us], rounded down to three significant digits.
        greatest_s: greatest lateness, not rounded [s].
    """

    counts: Counter[int] = field(default_factory=Counter)
    greatest_s: float = 0.0

    def add(self, lateness_s: float) -> None:
        """Count one tick."""
        us = int(lateness_s * 1e6)
        if us >= 1000:
            coarse = 10 ** (len(str(us)) - 3)
            us = us // coarse * coarse
        self.counts[us] += 1
        if lateness_s > self.greatest_s:
            self.greatest_s = lateness_s

    def quantile_us(self, share: float) -> float:
        """Lateness that this share of the ticks did not exceed, as it is counted [us]; 0 without ticks."""
        count = share * self.counts.total()
        seen = 0
        for us in sorted(self.counts):
            seen += self.counts[us]
            if seen >= count:
                return float(us)
        return 0.0

    def as_dict(self) -> dict[str, float]:
        """For the report, in microseconds."""
        return {
            "p50_us": self.quantile_us(0.5),
            "p99_us": self.quantile_us(0.99),
            "p99_9_us": self.quantile_us(0.999),
            "max_us": round(self.greatest_s * 1e6, 1),
        }


@dataclass(slots=True)
class RobotTally:
    """Tip error and limits of one robot while it followed targets.

    Attributes:
        followed: ticks in RUN.
        approached: ticks on the way to the first target.
        greatest_m: greatest distance of the commanded model's tip from the target [m].
        squares_m2: sum of its squares.
        residual_m: greatest residual of the inverse kinematics [m].
        unreachable: ticks whose target the model did not reach.
        off_m: greatest distance of the commanded tip from its target beyond the residual [m]; ticks in which
            a robot catches up at the limit of its rates do not count.
        last_off_m: the same in the newest tick, catching up or not.
        behind_m: the same in ticks in which a limit bound after the robot had caught up.
        missed_m: greatest residual of a target that was within reach when it was checked [m].
        joined_s: when the robot began to follow.
        caught_up: no limit has bound since then, or since a target out of reach, in at least one tick.
        far: a target was out of reach by more than a curve between reachable rows may bulge.
        limited: ticks by the limits that bound any axis, as bits of `contid.control.tick.limits`.
    """

    followed: int = 0
    approached: int = 0
    greatest_m: float = 0.0
    squares_m2: float = 0.0
    residual_m: float = 0.0
    unreachable: int = 0
    off_m: float = 0.0
    last_off_m: float = 0.0
    behind_m: float = 0.0
    missed_m: float = 0.0
    joined_s: float = -math.inf
    caught_up: bool = False
    far: bool = False
    limited: Counter[int] = field(default_factory=Counter)

    @property
    def off_target_m(self) -> float:
        """Distance of the tip from its targets beyond their residual [m].

        After a target out of reach only the last tick counts: near its limits a robot brakes and lags. One
        that was within reach when it was checked counts by its residual.
        """
        off_m = self.last_off_m if self.far else max(self.off_m, self.last_off_m)
        return max(off_m, self.missed_m)

    def on_path(self, off_m: float, limited: bool, timed: bool, joined_s: float) -> None:
        """Compare the commanded tip of a tick with its target.

        Args:
            off_m: tip error beyond the residual [m].
            limited: the command is not the answer of the model.
            timed: the target belongs to a trajectory; a stream may jump at any time.
            joined_s: when the robot began to follow.
        """
        if joined_s != self.joined_s:
            self.joined_s, self.caught_up = joined_s, False
        self.caught_up = self.caught_up or not limited
        self.last_off_m = max(off_m, 0.0)
        if limited and self.caught_up:
            self.behind_m = max(self.behind_m, self.last_off_m)
        if self.last_off_m > self.off_m and (not limited or (timed and self.caught_up)):
            self.off_m = self.last_off_m

    def off_path(self, behind_m: float) -> None:
        """Note a tick whose target is out of reach: the robot has to catch up with the next that is not.

        Args:
            behind_m: distance of the commanded tip from the nearest point that the model answered [m].
        """
        self.caught_up, self.last_off_m, self.far = False, behind_m, True

    def missed(self, residual_m: float) -> None:
        """Note a target that is out of reach, and was not when it was checked, by its residual [m]."""
        self.missed_m = max(self.missed_m, residual_m)

    def add(self, tip_error_m: float, converged: bool, residual_m: float = 0.0) -> None:
        """Count one tick in RUN.

        Args:
            tip_error_m: distance of the commanded model's tip from the target [m].
            converged: the model reached the target.
            residual_m: residual of the inverse kinematics [m].
        """
        self.followed += 1
        if residual_m > self.residual_m:
            self.residual_m = residual_m
        self.squares_m2 += tip_error_m * tip_error_m
        if tip_error_m > self.greatest_m:
            self.greatest_m = tip_error_m
        if not converged:
            self.unreachable += 1

    def as_dict(self) -> dict[str, Any]:
        """For the report, in millimetres."""
        rms_m = math.sqrt(self.squares_m2 / self.followed) if self.followed else 0.0
        return {
            "ticks_followed": self.followed,
            "ticks_approached": self.approached,
            "ik_residual_max_mm": m_to_mm(self.residual_m),
            "tip_error_max_mm": m_to_mm(self.greatest_m),
            "tip_error_rms_mm": m_to_mm(rms_m),
            "behind_max_mm": m_to_mm(self.behind_m),
            "ticks_unreachable": self.unreachable,
            "ticks_limited": {
                name: sum(count for bits, count in self.limited.items() if bits & bit)
                for bit, name in FLAG_NAMES.items()
                if any(bits & bit for bits in self.limited)
            },
        }
