"""A move at a share of the full speed: a line straight in its columns, or components of bends.

A move of the daemon goes as fast as the robot file allows. A slower one is sent as rows with times, which are
checked as a whole before anything moves, and followed under the same limits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

from contid_paths.bends import bends_of, between, components
from contid_paths.shapes import minimum_jerk

#: Rows per second; between them the daemon follows a smooth curve.
ROWS_PER_S: Final = 20.0
#: Greatest slope of `minimum_jerk`, which begins and ends at rest.
PEAK: Final = 1.875
#: A move takes at least the first, at most the second time [s].
SHORTEST_S: Final = 0.5
LONGEST_S: Final = 600.0


class TimedRows(NamedTuple):
    """A trajectory.

    Attributes:
        columns: its header, t_s first.
        rows: of numbers.
    """

    columns: list[str]
    rows: list[list[float]]


def slow_line(
    present: Mapping[str, float], target: Mapping[str, float], rates: Mapping[str, float], share: float
) -> TimedRows:
    """Rows from where the robots are to a target.

    Args:
        present: commanded value of every column of the target.
        target: value by column.
        rates: rate of every column at full speed [1/s].
        share: of that rate that no column exceeds, above 0.
    """
    ways = {column: abs(value - present[column]) for column, value in target.items()}
    for bend, azimuth in bends_of(target).items():
        del ways[azimuth]  # near straight it has no greatest rate; the components have the bend's
        ways[bend] = abs(components(target, bend, azimuth) - components(present, bend, azimuth))
    times = [PEAK * way / (share * rates[column]) for column, way in ways.items() if rates[column] > 0.0]
    duration_s = min(max(SHORTEST_S, *times, 0.0), LONGEST_S)
    count = math.ceil(duration_s * ROWS_PER_S)
    rows = []
    for number in range(count + 1):
        t = number / count
        rows.append([duration_s * t, *between(present, target, minimum_jerk(t))])
    return TimedRows(["t_s", *target], rows)
