"""The calibration of the tendon robot of a robot file: geometry, then stage after stage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.errors import ContidError
from contid.robot_file.tendon.robot import TendonRobot
from contid.units import MM_PER_M
from contid_fit.calibrate.tendon.geometry import FoundGeometry, find_geometry, nominal_of
from contid_fit.calibrate.tendon.recording import TendonRecording
from contid_fit.calibrate.tendon.stages import Stage, run_stages, split_rows

#: Fewer rows than this leave most parameters at what is expected of them.
MIN_ROWS = 40


@dataclass(frozen=True, eq=False)
class CalibratedTendons:
    """Result of a calibration.

    Attributes:
        geometry: geometry found from pulls of one tendon; None without them.
        both: rows fitted and rows kept out, columns in the order of the axes.
        stages: stages from constant curvature on.
    """

    geometry: FoundGeometry | None
    both: TendonRecording
    stages: tuple[Stage, ...]


def calibrate(
    robot: TendonRobot, data: TendonRecording, held_out: TendonRecording | None, keep_out: float
) -> CalibratedTendons:
    """Fit a robot.

    Args:
        robot: its lengths, radii and azimuths are what is expected before the data.
        data: pulls and tips.
        held_out: rows that follow them and are predicted; None: the last rows of ``data``.
        keep_out: share of ``data`` that is predicted, without ``held_out``.

    Raises:
        ContidError: too few rows, or other tendons than the robot's.
    """
    sections = robot.geometry.sections
    through = robot.geometry.routing == "through"
    count = tuple(len(section.angles_deg) for section in sections)
    for each in (data, *([] if held_out is None else [held_out])):
        if len(each.servos) != sum(count):
            raise ContidError(f"{each.name}: {len(each.servos)} servos, the robot has {sum(count)} tendons")
    # In sheaths a tendon alone bends its own section only; its place among the others does not show.
    geometry = find_geometry(data, count) if through else None
    if geometry is not None:
        if held_out is not None:
            data.followed_by(held_out)  # refuses other servos
            held_out = held_out.in_order(geometry.columns)
        data = data.in_order(geometry.columns)
        angles = np.array([each.angle_rad for each in geometry.tendons])
    else:
        angles = np.radians(np.concatenate([section.angles_deg for section in sections]))
    if held_out is None:
        data, held_out = split_rows(data, keep_out)
    if len(data) < MIN_ROWS:
        raise ContidError(f"{data.name}: {len(data)} rows to fit; give {MIN_ROWS} or more")
    both = data if held_out is None else data.followed_by(held_out)
    radius_m = float(np.mean([each for section in sections for each in section.radius_m]))
    lengths = [section.length_mm / MM_PER_M for section in sections]
    nominal = nominal_of(data, lengths, radius_m, angles, count, through)
    return CalibratedTendons(geometry, both, tuple(run_stages(data, held_out, nominal)))
