"""Which ticks of a run the check of its path computes: all near rows and near corners, samples elsewhere.

In the middle of a long interval between rows the curve is one slow cubic, and `SAMPLES` of it stand for all
ticks. The answers of a model need not be as smooth: where a limit such as a bend radius begins to bind, axes
change their speed at once. Intervals between samples that may have such a corner are divided, down to single
ticks.

Of a robot with more axes than coordinates of its tip every tick is computed, up to `EVERY` of an interval:
which of its answers a target has follows from the ticks before, and where the bends of least effort vanish,
answers turn within less than a sample.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from contid.control.tick.soft_start import fitted, played
from contid.kinematics.array import Array
from contid.trajectory.timed import Trajectory

#: Every tick is computed within this time after a row and before the next [s].
EDGE_S: Final = 0.5
#: Where an interval has more ticks than this, this many of them are computed.
SAMPLES: Final = 200
#: `SAMPLES` for robots with more axes than coordinates of the tip.
EVERY: Final = 100_000
#: An interval between samples that may have a corner is divided into this many parts.
PARTS: Final = 8
#: One of at most this many ticks is divided into single ticks.
SINGLE: Final = 32


@dataclass(frozen=True, slots=True)
class Tick:
    """A tick that is computed.

    Attributes:
        number: ticks since the run of the trajectory began.
        ticks: from the computed tick before to this one.
        time_s: time in the trajectory.
        row: index of the row that it leads to.
    """

    number: int
    ticks: int
    time_s: float
    row: int


#: Finds, among samples in order, the indices of those that may have a corner between them and the one before.
Corners = Callable[[Sequence[Tick]], Collection[int]]


def run_ticks(
    trajectory: Trajectory, rate_hz: float, lead: int, tail: int, corners: Corners, samples: int
) -> Iterator[Tick]:
    """The ticks of a run that are computed.

    Args:
        trajectory: to be played.
        rate_hz: of the tick.
        lead: ticks that the soft start needs (`contid.control.tick.soft_start`).
        tail: ticks that the soft end needs.
        corners: finds corners; called when the tick before its first sample has been computed.
        samples: ticks of an interval that are computed, where it has more.
    """
    length, lead, tail, total = _fitted(trajectory, rate_hz, lead, tail)
    last = len(trajectory) - 1

    def at(number: int, ticks: int) -> Tick:
        time_s = trajectory.start_s + played(number, length, lead, tail) / rate_hz
        return Tick(number, ticks, time_s, min(trajectory.row_at(time_s) + 1, last))

    full_pace = range(lead, math.ceil(total - tail))
    chosen = _sampled(trajectory, rate_hz, total, full_pace, samples, at)
    block: list[Tick] = []
    for tick in chosen:
        if tick.ticks > 1:
            block.append(tick)
            continue
        if block:
            yield from _divided(block, tick, at, corners)
            block = []
        yield tick
    yield from block


class EveryTick:
    """All ticks of a run of which `run_ticks` leaves none out.

    Attributes:
        times_s: times in the trajectory, shape ``(ticks,)``.
        rows: indices of the rows that they lead to, shape ``(ticks,)``.
    """

    def __init__(self, trajectory: Trajectory, rate_hz: float, lead: int, tail: int) -> None:
        length, lead, tail, total = _fitted(trajectory, rate_hz, lead, tail)
        count = math.ceil(total)
        numbers = np.arange(count + 1)
        ticks = numbers - lead / 2
        for n in (*range(min(lead, count)), *range(max(0, math.floor(total - tail) - 1), count)):
            ticks[n] = played(n, length, lead, tail)
        self.times_s: Array = np.asarray(trajectory.start_s + ticks / rate_hz, dtype=np.float64)
        self.times_s[-1] = trajectory.end_s
        last = len(trajectory) - 1
        self.rows = np.minimum(np.maximum(trajectory.rows_at(self.times_s), 0) + 1, last)
        self.rows[-1] = last

    def __len__(self) -> int:
        """Number of ticks."""
        return len(self.times_s)

    def __getitem__(self, number: int) -> Tick:
        """A tick as `run_ticks` has it."""
        return Tick(number, 1, float(self.times_s[number]), int(self.rows[number]))


def computes_every(trajectory: Trajectory, rate_hz: float) -> bool:
    """True when no interval between rows is so long that `run_ticks` leaves ticks out."""
    longest_s = float(np.diff(trajectory.times_s).max(initial=0.0))
    return longest_s * rate_hz < 3 * math.ceil(EDGE_S * rate_hz)


class _Lengths(NamedTuple):
    """Lengths in ticks: of the trajectory, of the soft start and end, and of the run."""

    trajectory: float
    lead: int
    tail: int
    run: float


def _fitted(trajectory: Trajectory, rate_hz: float, lead: int, tail: int) -> _Lengths:
    """The lengths of a run, its soft start and end fitted into the trajectory."""
    length = (trajectory.end_s - trajectory.start_s) * rate_hz
    lead, tail = fitted(lead, length), fitted(tail, length)
    return _Lengths(length, lead, tail, length + 0.5 * (lead + tail))


def _sampled(
    trajectory: Trajectory,
    rate_hz: float,
    total: float,
    full_pace: range,
    samples: int,
    at: Callable[[int, int], Tick],
) -> Iterator[Tick]:
    """The ticks that are computed where there is no corner.

    Args:
        trajectory: to be played.
        rate_hz: of the tick.
        total: ticks of the run.
        full_pace: numbers of the ticks between soft start and soft end.
        samples: ticks of an interval that are computed, where it has more.
        at: the tick of a number, and of ticks since the one before.
    """
    edge = math.ceil(EDGE_S * rate_hz)
    n, step = 0, 1
    while n < total:
        tick = at(n, step)
        yield tick
        step = 1
        if n in full_pace:
            before = (tick.time_s - trajectory.time_of_row(tick.row - 1)) * rate_hz
            ahead = (trajectory.time_of_row(tick.row) - tick.time_s) * rate_hz
            if before >= edge and ahead > 2 * edge:
                step = max(1, min(int(ahead) - edge, int((before + ahead) / samples)))
        n += step
    yield Tick(n, step, trajectory.end_s, len(trajectory) - 1)


def _divided(
    block: list[Tick], after: Tick, at: Callable[[int, int], Tick], corners: Corners
) -> Iterator[Tick]:
    """Samples, with more of them next to corners, down to single ticks.

    Args:
        block: samples of one interval, which begins after the tick before the first of them.
        after: the computed tick that follows them.
        at: the tick of a number, and of ticks since the one before.
        corners: finds them.
    """
    while True:
        found = corners([*block, after])
        ends = [block[0].number - block[0].ticks]
        for index, sample in enumerate(block):
            parts = PARTS if sample.ticks > SINGLE else sample.ticks
            parts = parts if index in found else 1
            begin = sample.number - sample.ticks
            ends += [begin + sample.ticks * part // parts for part in range(1, parts + 1)]
        if len(ends) == len(block) + 1:
            break
        block = [at(end, end - begin) for begin, end in pairwise(ends)]
    yield from block
