"""Values on the way between two rows: linear in every column, but in the components of a bend.

A bend with an azimuth has the components ``bend cos azimuth`` and ``bend sin azimuth``: from 170 to -170
degrees it turns by 20, and at the straight pose its azimuth changes to the other side at once, as between the
rows of a trajectory (`contid.trajectory.arc_columns`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

_AZIMUTH: Final = "azimuth_deg"
_BENDS: Final = ("bend_deg", "curvature_per_m")


def bends_of(target: Mapping[str, float]) -> dict[str, str]:
    """Columns of the azimuths of a target, by the columns of their bends or curvatures."""
    azimuths = [column for column in target if column.rpartition(".")[2] == _AZIMUTH]
    pairs = [(column.removesuffix(_AZIMUTH) + bend, column) for column in azimuths for bend in _BENDS]
    return {bend: azimuth for bend, azimuth in pairs if bend in target}


def components(row: Mapping[str, float], bend: str, azimuth: str) -> complex:
    """The components u + iv of a bend of a row, in the unit of the bend."""
    angle = math.radians(row[azimuth])
    return row[bend] * complex(math.cos(angle), math.sin(angle))


def between(start: Mapping[str, float], target: Mapping[str, float], share: float) -> list[float]:
    """Values of the columns of a target after a share of the way to it, exact at both ends.

    Args:
        start: value of every column of the target where the way begins.
        target: value by column, in the units of a trajectory.
        share: 0 at the start to 1 at the target.
    """
    if share <= 0.0 or share >= 1.0:
        return [(start if share <= 0.0 else target)[column] for column in target]
    row = {column: start[column] + share * (end - start[column]) for column, end in target.items()}
    for bend, azimuth in bends_of(target).items():
        begin, end = (components(each, bend, azimuth) for each in (start, target))
        here = begin + share * (end - begin)
        row[bend], row[azimuth] = abs(here), math.degrees(math.atan2(here.imag, here.real))
    return list(row.values())
