"""How good the places are that a tip reaches: its compliance, accuracy and dexterity as maps.

Each measure is taken at the answer of the inverse kinematics to the centre of a voxel, without load:

    compliance   greatest singular value of dtip/dforce: how far the tip gives way to a newton
    accuracy     greatest standard deviation of the tip over all directions, of the covariance
                 J S J^T by independent errors of the axes, plus what a load calibration left open
    dexterity    least over greatest singular value of J diag(travel): 1 where the tip moves alike in all
                 directions, 0 where it cannot move in one (J. K. Salisbury and J. J. Craig,
                 "Articulated hands", Int. J. Robotics Research 1(1), 1982)
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import Compliant, Model, build_model_for_ticks
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.robot import RobotDescription
from contid.targets import ZERO3, Actuation
from contid.units import BAR, MM_PER_M
from contid_fit.identified_arm import IdentifiedArm
from contid_reach.spatial import Progress, reachable_volume


class Measure(enum.StrEnum):
    """A measure of the places of a tip."""

    COMPLIANCE = "compliance"
    ACCURACY = "accuracy"
    DEXTERITY = "dexterity"


#: Unit in which each measure is printed, and printed units per SI unit.
UNITS: Final = {
    Measure.COMPLIANCE: ("mm/N", MM_PER_M),
    Measure.ACCURACY: ("mm", MM_PER_M),
    Measure.DEXTERITY: ("", 1.0),
}

_Of: TypeAlias = Callable[[Actuation], float]


@dataclass(frozen=True, eq=False, slots=True)
class QualityMap:
    """A measure at the places that one tip reaches.

    Attributes:
        measure: what the values are.
        points_m: places in the world [m], shape ``(n, 3)``.
        values: one per place, in `UNITS`, shape ``(n,)``; NaN where the model has no stable answer.
        edge_m: distance of neighbours [m].
        planar: all places have the same z.
    """

    measure: Measure
    points_m: Array
    values: Array
    edge_m: float
    planar: bool

    def quantile(self, share: float) -> float:
        """The value below which a share of the places is."""
        return float(np.nanquantile(self.values, share))

    def place_of(self, value: float) -> tuple[float, float, float]:
        """Place with the nearest value [m]."""
        x, y, z = self.points_m[int(np.nanargmin(np.abs(self.values - value)))].tolist()
        return x, y, z


def quality_map(
    name: str,
    robot: RobotDescription,
    measure: Measure,
    *,
    axis_sigma: float | None = None,
    edge_m: float | None = None,
    across: int = 24,
    progress: Progress | None = None,
) -> QualityMap:
    """The map of a measure over the reach of one robot.

    Args:
        name: name of the robot, for messages.
        robot: its description.
        measure: what to map.
        axis_sigma: standard deviation of an axis [m or Pa], for the accuracy.
        edge_m: distance of neighbouring places [m]; None for ``across`` places over the widest side.
        across: see ``edge_m``.
        progress: called with the number of places tested so far.

    Raises:
        ContidError: the model has no compliance, errors of the axes are not stated, nothing is reached, or it
            is stable nowhere.
    """
    model, planar = build_model_for_ticks(robot), robot.dimension == 2
    of = _measure_of(name, robot, model, measure, axis_sigma)
    frame = BaseFrame.of(robot.base)
    volume = reachable_volume(model, frame, edge_m=edge_m, across=across, progress=progress, planar=planar)
    if not volume.answers:
        raise ContidError(f"{name}: no place reached on a grid of {volume.edge_m * MM_PER_M:.3g} mm")
    places = sorted(volume.answers)
    scale = UNITS[measure][1]
    values = np.array([of(volume.answers[place]) * scale for place in places])
    if np.isnan(values).all():
        raise ContidError(f"{name}: no {measure} is known: no stable equilibrium at {len(places)} places")
    return QualityMap(measure, np.array(places, dtype=float) * volume.edge_m, values, volume.edge_m, planar)


def _measure_of(
    name: str, robot: RobotDescription, model: Model, measure: Measure, axis_sigma: float | None
) -> _Of:
    dimension = robot.dimension
    if measure is Measure.COMPLIANCE:
        if not isinstance(model, Compliant):
            raise ContidError(f"{name}: no compliance, model {robot.model} does not bend under a load")
        return lambda actuation: float(np.linalg.norm(model.compliance(actuation), 2))
    if measure is Measure.DEXTERITY:
        travel = np.subtract(model.upper, model.lower)
        return lambda actuation: _isotropy(model.jacobian(actuation)[:dimension] * travel)
    if isinstance(robot, Cosserat) and robot.sense is not None:
        return _CalibratedAccuracy(robot, axis_sigma or 0.0)
    if axis_sigma is None:
        unit = robot.quantity.unit
        raise ContidError(
            f"{name}: accuracy needs --axis-sigma, the standard deviation of an axis in {unit}"
            + (", or sense.load.calibration (`contid calibrate load`)" if isinstance(robot, Cosserat) else "")
        )
    sigma = axis_sigma
    return lambda actuation: sigma * float(np.linalg.norm(model.jacobian(actuation)[:dimension], 2))


def _isotropy(jacobian: Array) -> float:
    """Least over greatest singular value over the directions of the tip; 0 with fewer axes than those."""
    if jacobian.shape[1] < jacobian.shape[0]:
        return 0.0
    values = np.linalg.svd(jacobian, compute_uv=False).tolist()
    return float(values[-1] / values[0]) if values[0] > 0.0 else 0.0


class _CalibratedAccuracy:
    """Accuracy of an arm with an identified error: what its calibration left open, and errors of the axes.

    The side of every hysteresis loop is unknown.
    """

    def __init__(self, robot: Cosserat, axis_sigma: float) -> None:
        self._arm = IdentifiedArm(robot)
        self._axis_sigma_bar = axis_sigma / BAR

    def __call__(self, actuation: Actuation) -> float:
        """Greatest standard deviation of the tip [m]; NaN where the arm is not stable."""
        arm, pressures = self._arm, [value / BAR for value in actuation]
        unknown = [0.0] * len(pressures)
        corrected = arm.corrected(pressures, unknown)
        moment = arm.base_moment(corrected)
        if moment is None:
            return math.nan
        found = [arm.near(corrected, ZERO3, moment, scale) for scale in range(-1, arm.scales)]
        if any(each is None for each in found):
            return math.nan
        here, *moved = [each for each in found if each is not None]
        by_pressure = np.array(here.by_pressure_mm_bar).reshape(3, -1)
        by_scale = np.array([np.subtract(each.tip_mm, here.tip_mm) for each in moved]).T / arm.steps
        covariance = arm.covariance_mm2(pressures, unknown, by_pressure, by_scale)
        covariance += arm.sides_mm2([1.0] * len(pressures), by_pressure)
        covariance += self._axis_sigma_bar**2 * by_pressure @ by_pressure.T
        return math.sqrt(float(np.linalg.eigvalsh(covariance)[-1])) / MM_PER_M
