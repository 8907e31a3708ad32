"""Finds the section and the azimuth of the tendon of each servo, from pulls of one tendon alone.

All other tendons are slack meanwhile. A tendon of section j alone bends all sections up to j, by the same
moment. The tip moves towards the tendon, the farther per pull the nearer its section is to the base, because
the rest of the robot is a longer lever. The tendons of one section have nearly the same such gain and stand
evenly around the backbone: servos are assigned to sections so that the squares of both deviations are least.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid_fit.calibrate.tendon.models import Nominal
from contid_fit.calibrate.tendon.recording import TendonRecording

#: A tendon is pulled in rows where its pull is above this [m].
PULLED_M: Final = 0.3e-3
#: A tendon is slack in rows where its pull is below this [m].
SLACK_M: Final = -2e-3
#: Rows in which every tendon must be pulled alone, at least.
_MIN_ROWS: Final = 4
#: Deviations that weigh the same: of the logarithm of the gain, and of an azimuth from even spacing [rad].
_GAIN_SPREAD: Final = 0.05
_ANGLE_SPREAD: Final = 0.2


@dataclass(frozen=True, eq=False)
class FoundTendon:
    """What the pulls of one servo show.

    Attributes:
        servo: name of the servo's column in the recording.
        column: index of that column among the servos.
        section: index of the section whose tendon it pulls, from 0 at the base.
        angle_rad: direction in which the tip moves, from x towards y: the azimuth of the tendon.
        gain: length of the tip's motion per pull [m/m].
        rows: number of rows where it is pulled alone.
    """

    servo: str
    column: int
    section: int
    angle_rad: float
    gain: float
    rows: int


@dataclass(frozen=True)
class FoundGeometry:
    """The tendons, section after section.

    Attributes:
        tendons: tendons in the order of the model, section after section.
        margin: least growth of the cost of the assignment, a sum of squares, when two servos of different
            sections are exchanged; where it is small, the sections are uncertain.
    """

    tendons: tuple[FoundTendon, ...]
    margin: float

    @property
    def columns(self) -> list[int]:
        """Index of the servo's column for each tendon of the model."""
        return [tendon.column for tendon in self.tendons]


def find_geometry(recording: TendonRecording, count: Sequence[int]) -> FoundGeometry | None:
    """Find sections and azimuths of the servos; None if no tendon is pulled alone.

    Args:
        recording: pulls and tips.
        count: number of tendons of each section, from the base on.

    Raises:
        ContidError: some servos are pulled alone and others never are, or the number of servos differs.
    """
    if len(recording.servos) != sum(count):
        raise ContidError(
            f"{recording.name}: {len(recording.servos)} servos, the robot has {sum(count)} tendons"
        )
    alone = [_alone(recording.pull_m, column) for column in range(len(recording.servos))]
    missing = [
        name for name, rows in zip(recording.servos, alone, strict=True) if np.count_nonzero(rows) < _MIN_ROWS
    ]
    if len(missing) == len(alone):
        return None
    if missing:
        names = ", ".join(missing)
        raise ContidError(f"{recording.name}: pulled alone in fewer than {_MIN_ROWS} rows: {names}")
    slopes = [_slope(recording.pull_m[rows, i], recording.tip_m[rows, :2]) for i, rows in enumerate(alone)]
    gains = np.array([float(np.hypot(*slope)) for slope in slopes])
    angles = np.array([float(np.arctan2(slope[1], slope[0])) for slope in slopes])
    assigned = _assign(gains, angles, count)
    tendons = [
        FoundTendon(
            recording.servos[i],
            i,
            int(assigned.section[i]),
            float(angles[i]),
            float(gains[i]),
            int(np.count_nonzero(alone[i])),
        )
        for i in range(len(gains))
    ]
    return FoundGeometry(tuple(sorted(tendons, key=lambda tendon: tendon.section)), assigned.margin)


def nominal_of(
    recording: TendonRecording,
    length_m: Sequence[float],
    radius_m: float,
    angle_rad: Array,
    count: Sequence[int],
    through: bool = True,
) -> Nominal:
    """The robot before the fit, standing along z so that the highest measured tip is the straight one's.

    Args:
        recording: pulls and tips [m].
        length_m: length of each section [m].
        radius_m: distance of the tendons from the backbone [m].
        angle_rad: azimuth of every tendon [rad], shape ``(tendons,)``.
        count: number of tendons of each section.
        through: True when tendons run through the sections before their own.
    """
    height = float(np.max(recording.tip_m[:, 2]) - sum(length_m))
    return Nominal(tuple(length_m), radius_m, angle_rad, tuple(count), (0.0, 0.0, height), through)


def _alone(pull: Array, column: int) -> NDArray[np.bool_]:
    """The rows in which only the tendon of a column is pulled, shape ``(rows,)``."""
    others = np.delete(pull, column, axis=1)
    rows: NDArray[np.bool_] = (pull[:, column] > PULLED_M) & (others < SLACK_M).all(axis=1)
    return rows


class _Assignment(NamedTuple):
    """Index of the section of each servo, and the least growth of the cost by an exchange of two servos."""

    section: NDArray[np.intp]
    margin: float


def _assign(gains: Array, angles: Array, count: Sequence[int]) -> _Assignment:
    """Assign servos to sections: sorted by gain, then the best exchange of two until none lowers the cost."""
    section = np.empty(len(gains), dtype=np.intp)
    section[np.argsort(-gains, kind="stable")] = np.repeat(np.arange(len(count)), count)
    cost = _deviation(section, gains, angles)
    while True:
        best, margin = section, math.inf
        for i, j in itertools.combinations(range(len(gains)), 2):
            if section[i] != section[j]:
                trial = section.copy()
                trial[[i, j]] = section[[j, i]]
                change = _deviation(trial, gains, angles) - cost
                if change < margin:
                    best, margin = trial, change
        if margin >= 0.0:
            return _Assignment(section, margin)
        section, cost = best, cost + margin


def _deviation(section: NDArray[np.intp], gains: Array, angles: Array) -> float:
    """Cost of an assignment: squares of the deviations inside the sections, each over its spread."""
    total = 0.0
    for index in range(int(np.max(section)) + 1):
        log_gains = np.log(gains[section == index])
        total += float(((log_gains - log_gains.mean()) ** 2).sum()) / _GAIN_SPREAD**2
        n = len(log_gains)
        # With even spacing all azimuths are the same modulo the spacing, and one tendon is in each slot.
        slots = np.arange(n) * 2.0 * math.pi / n
        turned = np.sort(np.mod(angles[section == index], 2.0 * math.pi)) - slots
        total += float(((turned - turned.mean()) ** 2).sum()) / _ANGLE_SPREAD**2
    return total


def _slope(pull: Array, tip: Array) -> Array:
    """Least-squares slope of the tip in x and y over the pull [m/m], shape (2,)."""
    centred = pull - pull.mean()
    slope: Array = centred @ (tip - tip.mean(axis=0)) / float(centred @ centred)
    return slope
