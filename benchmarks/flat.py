"""Growth of memory and descriptors of long-lived processes: samples, slopes, a verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Final

import psutil

#: After this share of the run caches are warm; growth counts from then on.
WARM: Final = 0.25
#: A process grows when its slope is surely above this (34 MB a week) and it grew by more than the noise.
FLAT_KB_PER_H: Final = 200.0
NOISE_KB: Final = 1024.0
#: Clients that are there at the moment, and sockets being accepted.
FEW_DESCRIPTORS: Final = 6
#: Below this, what is extrapolated to an hour is noise.
MIN_H: Final = 0.1
#: Number of equal parts of the run whose means are fitted: they are independent, where samples are not.
PARTS: Final = 10


@dataclass(frozen=True, slots=True)
class Look:
    """One process at one time: resident, proportional and own memory [kB]; open descriptors.

    ``own_kb`` is anonymous memory. Pages of libraries do not count: they become private (psutil's ``uss``)
    when another process that mapped them ends.
    """

    t_s: float
    rss_kb: float
    pss_kb: float
    own_kb: float
    descriptors: int


def look(process: psutil.Process, t_s: float) -> Look:
    """Look at a process."""
    try:
        _, *lines = Path(f"/proc/{process.pid}/smaps_rollup").read_text().splitlines()
    except (OSError, ValueError):  # gone, or dead and not yet waited for
        raise psutil.NoSuchProcess(process.pid) from None
    kb = {name: float(rest.split()[0]) for name, _, rest in (line.partition(":") for line in lines)}
    return Look(t_s, kb["Rss"], kb["Pss"], kb["Anonymous"], process.num_fds())


@dataclass(frozen=True, slots=True)
class Slope:
    """How memory of its own changes [kB/h]: 95 % sure within ``plus_minus``; NaN when there is too little."""

    kb_per_h: float
    plus_minus: float
    grown_kb: float
    descriptors: float

    @property
    def flat(self) -> bool:
        """False when it surely grows."""
        surely = self.kb_per_h - self.plus_minus
        return self.descriptors <= FEW_DESCRIPTORS and not (
            surely > FLAT_KB_PER_H and self.grown_kb > NOISE_KB
        )

    def __str__(self) -> str:
        """For the verdict."""
        slope = "too short for a slope"
        if math.isfinite(self.plus_minus):
            slope = f"{self.kb_per_h:+.0f} ± {self.plus_minus:.0f} kB/h"
        word = "flat" if self.flat else "GROWS"
        return f"{word} ({slope}, {self.grown_kb:+.0f} kB, {self.descriptors:+.0f} descriptors)"


def slope_of(looks: Sequence[Look]) -> Slope:
    """Fit a line to the warm part of a run."""
    from scipy.stats import t

    warm = looks[int(WARM * len(looks)) :]
    size = max(len(warm) // PARTS, 1)
    parts = [warm[at : at + size] for at in range(0, len(warm) - size + 1, size)]
    hours = [_mean([each.t_s for each in part]) / 3600.0 for part in parts]
    memory = [_mean([each.own_kb for each in part]) for part in parts]
    descriptors = [median([each.descriptors for each in part]) for part in parts]  # a lost bus has fewer
    count = len(parts)
    if count < 4 or hours[-1] - hours[0] < MIN_H:
        return Slope(math.nan, math.inf, memory[-1] - memory[0], descriptors[-1] - descriptors[0])
    middle, level = _mean(hours), _mean(memory)
    spread = sum((hour - middle) ** 2 for hour in hours)
    slope = sum((h - middle) * (m - level) for h, m in zip(hours, memory, strict=True)) / spread
    left = sum((m - level - slope * (h - middle)) ** 2 for h, m in zip(hours, memory, strict=True))
    error = math.sqrt(left / (count - 2) / spread)
    return Slope(
        slope,
        float(t.ppf(0.975, count - 2)) * error,
        memory[-1] - memory[0],
        descriptors[-1] - descriptors[0],
    )


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
