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
    """Histogram of how late ticks started; microseconds to three significant digits."""

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
        """Lateness that this share of the ticks did not exceed [us], 0 without ticks."""
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
        greatest_m: greatest distance of the commanded model's tip from the target [m].
        squares_m2: sum of its squares.
        unreachable: ticks whose target the model did not reach.
        limited: ticks per limit that bound any axis.
    """

    followed: int = 0
    greatest_m: float = 0.0
    squares_m2: float = 0.0
    unreachable: int = 0
    limited: Counter[int] = field(default_factory=Counter)

    def add(self, tip_error_m: float, converged: bool) -> None:
        """Count one tick in RUN."""
        self.followed += 1
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
            "tip_error_max_mm": m_to_mm(self.greatest_m),
            "tip_error_rms_mm": m_to_mm(rms_m),
            "ticks_unreachable": self.unreachable,
            "ticks_limited": {
                name: sum(count for bits, count in self.limited.items() if bits & bit)
                for bit, name in FLAG_NAMES.items()
                if any(bits & bit for bits in self.limited)
            },
        }
