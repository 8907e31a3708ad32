"""Coupled drives of a tendon robot in its file: motors that wind several tendons at once.

The pulls of the tendons are ``q = D m``, with the travel m of every drive and one column of D per drive. The
bends that drives reach are ``Theta = A m``. Without tensions A follows from ``D m = G Theta``, with them from
the balance of tendons and backbone (`contid.kinematics.tendon.tension`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from contid.robot_file.axis_names import axis_name_mistake
from contid.robot_file.base import Interval, Strict

if TYPE_CHECKING:
    from contid.robot_file.tendon.sections import TendonRobotGeometry

#: Least range of the travel on either side of the straight robot; no drive resolves less.
_ROOM_MM: Final = 1e-3
#: Of the largest singular value: below it drives bend the robot in the same way.
_ALIKE: Final = 1e-6
#: Part of the pulls of a drive that no bend has, by which rounded azimuths are off.
_ROUNDED: Final = 1e-3


class Drive(Strict):
    """One motor and the tendons that it winds.

    Attributes:
        pulls: pull of each tendon per travel of the drive: 1 winds in, -1 pays out, other numbers are ratios
            of spool radii or of a differential.
        travel_mm: ``[min, max]`` travel from the straight robot: what a spool with the ratio 1 winds in.
    """

    pulls: Annotated[dict[str, float], Field(min_length=1)]
    travel_mm: Interval

    @model_validator(mode="after")
    def _has_room(self) -> Drive:
        low, high = self.travel_mm
        if not low <= -_ROOM_MM <= _ROOM_MM <= high:
            raise ValueError(
                f"travel_mm [{low:g}, {high:g}] has no room on both sides of 0, the straight robot"
            )
        return self


def drive_matrix(drives: Mapping[str, Drive], tendons: Sequence[str]) -> NDArray[np.float64]:
    """D, pulls of tendons by travels of drives, shape ``(tendons, drives)``; drives in file order."""
    rows = [[drive.pulls.get(tendon, 0.0) for drive in drives.values()] for tendon in tendons]
    return np.array(rows, dtype=np.float64).reshape(len(tendons), len(drives))


def check_drives(
    drives: Mapping[str, Drive], tendons: Sequence[str], geometry: TendonRobotGeometry, *, elastic: bool
) -> Iterator[str]:
    """Findings about the drives of a robot; each message begins with the key that it is about.

    Args:
        drives: of the robot.
        tendons: names of its tendons.
        geometry: its dimensions.
        elastic: True where its tendons have a stiffness.
    """
    for name, drive in drives.items():
        if mistake := axis_name_mistake(name):
            yield f"drives.{name}: {mistake}"
        for tendon, ratio in drive.pulls.items():
            if tendon not in tendons:
                yield f"drives.{name}.pulls: no tendon {tendon!r}; this robot has {', '.join(tendons)}"
            elif ratio == 0.0:
                yield f"drives.{name}.pulls: 0 for {tendon} moves nothing; leave it out"
    loose = [each for each in tendons if not any(each in drive.pulls for drive in drives.values())]
    if loose:
        yield f"drives: no drive pulls {', '.join(loose)}; write each tendon into the pulls of a drive"
        return
    found, bends = drive_matrix(drives, tendons), geometry.pull_matrix
    most = np.linalg.matrix_rank(bends, _ALIKE * np.linalg.norm(bends, 2))
    if len(drives) > most:
        yield (
            f"drives: {len(drives)} drives for tendons that bend in {most} ways; allowed are at most {most}. "
            "For a motor per tendon leave out drives"
        )
        return
    by_drives = np.linalg.pinv(bends) @ found
    if not elastic:
        off = np.linalg.norm(found - bends @ by_drives, axis=0) / np.linalg.norm(found, axis=0)
        for name, part in zip(drives, off, strict=True):
            if part > _ROUNDED:
                yield (
                    f"drives.{name}.pulls: no bend of the backbone pulls its tendons in these ratios; "
                    "correct them, or write tension:, which gives the tendons a stiffness"
                )
    columns = np.linalg.norm(by_drives, axis=0)
    if min(columns) <= _ALIKE * max(columns) or np.linalg.cond(by_drives / columns) > 1.0 / _ALIKE:
        yield "drives: two of them bend the robot in the same way, or one does not bend it at all"
