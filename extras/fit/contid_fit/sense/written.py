"""A calibration without load as keys of a robot file."""

from __future__ import annotations

from typing import Any

import numpy as np

from contid.robot_file.cosserat import Cosserat
from contid.units import BAR, MM_PER_M
from contid_fit.sense.calibration import LoadCalibration


def calibration_keys(robot: Cosserat, found: LoadCalibration) -> dict[str, Any]:
    """The keys of ``sense.load.calibration``; pressures in bar.

    Args:
        robot: that was calibrated with `contid_fit.sense.rod_family`.
        found: its calibration, in Pa.
    """
    axes, sections = len(robot.axis_names), len(robot.geometry.sections)
    units = np.array([*[1.0 / BAR] * axes, *[1.0] * axes, *[1.0 / BAR] * axes, *[1.0] * (4 * sections)])
    factor = np.linalg.cholesky(found.covariance * np.outer(units, units))
    offset, gain, loop = found.correction.reshape(3, axes)
    modulus, moment, density, link = found.parameters.reshape(4, sections)
    return {
        "offset_bar": _short(offset / BAR),
        "gain": _short(gain),
        "loop_bar": _short(loop / BAR),
        "modulus": _short(modulus),
        "moment": _short(moment),
        "density_kg_m3": _short(density),
        "link_mass_g": _short(link),
        "creep_per_decade": _short([found.creep.per_decade])[0],
        "creep_sigma": _short([found.creep.sigma])[0],
        "axis_sigma_bar": _short([found.axis_sigma / BAR])[0],
        "tip_sigma_mm": _short([found.tip_sigma_m * MM_PER_M])[0],
        "covariance_factor": [_short(row[: i + 1]) for i, row in enumerate(factor)],
        "corrects": "robot",
    }


def _short(values: Any) -> list[float]:
    """Five significant digits are far below the uncertainty."""
    return [float(f"{value:.5g}") for value in values]
