"""Section and azimuth of the tendon of each servo, from pulls of one tendon while all others are slack.

A tendon of section j alone bends all sections up to j, by the same moment. The tip moves towards the
tendon, the farther per pull the nearer its section is to the base, because the rest of the robot is a
longer lever. The tendons of one section have nearly the same such gain and stand evenly around the
backbone: servos are assigned to sections so that the squares of both deviations are least.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid_fit.calibrate.tendon.models import Nominal
from contid_fit.calibrate.tendon.recording import TendonRecording

#: One tendon is pulled alone in rows where it is above the first and all others are below the second [m].
PULLED_M: Final = 0.3e-3
SLACK_M: Final = -2e-3
_ROWS: Final = 4
#: Deviations that weigh the same: of the logarithm of the gain, and of an azimuth from even spacing [rad].
_GAIN_SPREAD: Final = 0.05
_ANGLE_SPREAD: Final = 0.2


@dataclass(frozen=True, eq=False)
class FoundTendon:
    """What the pulls of one servo show.

    Attributes:
        servo: name of its column.
        column: number of its column.
        section: number of its section, from 0.
        angle_rad: direction of the tip's motion, from x towards y.
        gain: motion of the tip over pull.
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
        tendons: in the order of the model.
        margin: least growth of the sum of squares when two servos of different sections are exchanged; where
            it is small, the sections are uncertain.
    """

    tendons: tuple[FoundTendon, ...]
    margin: float

    @property
    def columns(self) -> list[int]:
        """Column of each tendon of the model."""
        return [each.column for each in self.tendons]


def find_geometry(recording: TendonRecording, count: Sequence[int]) -> FoundGeometry | None:
    """Sections and azimuths of the servos; None if no tendon is pulled alone.

    Raises:
        ContidError: some servos are pulled alone and others never are, or the number of servos differs.
    """
    if len(recording.servos) != sum(count):
        raise ContidError(
            f"{recording.name}: {len(recording.servos)} servos, the robot has {sum(count)} tendons"
        )
    alone = [_alone(recording.pull_m, column) for column in range(len(recording.servos))]
    missing = [
        name for name, rows in zip(recording.servos, alone, strict=True) if np.count_nonzero(rows) < _ROWS
    ]
    if len(missing) == len(alone):
        return None
    if missing:
        raise ContidError(f"{recording.name}: pulled alone in fewer than {_ROWS} rows: {', '.join(missing)}")
    slopes = [_slope(recording.pull_m[rows, i], recording.tip_m[rows, :2]) for i, rows in enumerate(alone)]
    gains = np.array([float(np.hypot(*slope)) for slope in slopes])
    angles = np.array([float(np.arctan2(slope[1], slope[0])) for slope in slopes])
    section, margin = _assign(gains, angles, count)
    found = [
        FoundTendon(
            recording.servos[i],
            i,
            int(section[i]),
            float(angles[i]),
            float(gains[i]),
            int(np.count_nonzero(alone[i])),
        )
        for i in range(len(gains))
    ]
    return FoundGeometry(tuple(sorted(found, key=lambda each: each.section)), margin)


def nominal_of(
    recording: TendonRecording,
    length_m: Sequence[float],
    radius_m: float,
    angle_rad: Array,
    count: Sequence[int],
    through: bool = True,
) -> Nominal:
    """The robot before the fit, standing along z so that the highest measured tip is the straight one's."""
    height = float(np.max(recording.tip_m[:, 2]) - sum(length_m))
    return Nominal(tuple(length_m), radius_m, angle_rad, tuple(count), (0.0, 0.0, height), through)


def _alone(pull: Array, column: int) -> NDArray[np.bool_]:
    others = np.delete(pull, column, axis=1)
    rows: NDArray[np.bool_] = (pull[:, column] > PULLED_M) & (others < SLACK_M).all(axis=1)
    return rows


def _assign(gains: Array, angles: Array, count: Sequence[int]) -> tuple[NDArray[np.intp], float]:
    """Section of each servo: sorted by gain, then the best exchange of two until none helps."""
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
            return section, margin
        section, cost = best, cost + margin


def _deviation(section: NDArray[np.intp], gains: Array, angles: Array) -> float:
    """Squares of the deviations inside the sections."""
    total = 0.0
    for each in range(int(np.max(section)) + 1):
        own = np.log(gains[section == each])
        total += float(((own - own.mean()) ** 2).sum()) / _GAIN_SPREAD**2
        n = len(own)
        # With even spacing all azimuths are the same modulo the spacing, and one tendon is in each slot.
        turned = np.sort(np.mod(angles[section == each], 2.0 * math.pi)) - np.arange(n) * 2.0 * math.pi / n
        total += float(((turned - turned.mean()) ** 2).sum()) / _ANGLE_SPREAD**2
    return total


def _slope(pull: Array, tip: Array) -> Array:
    """Least-squares motion of the tip in x and y over pull."""
    centred = pull - pull.mean()
    slope: Array = centred @ (tip - tip.mean(axis=0)) / float(centred @ centred)
    return slope
