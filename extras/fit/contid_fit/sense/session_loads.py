"""Loads of a recorded session, with the calibration from another one without load."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import build_model
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import LoadedFile
from contid.session.read import Session
from contid.units import STANDARD_GRAVITY
from contid_fit.sense.calibration import CalibrationError, LoadCalibration, calibrate_without_load, rod_family
from contid_fit.sense.chosen_robot import chosen_robot
from contid_fit.sense.creep import Drifts
from contid_fit.sense.estimator import NORMAL_95, LoadEstimator
from contid_fit.sense.rests import rests


@dataclass(frozen=True, slots=True)
class RestLoad:
    """The load while an arm rested.

    Attributes:
        start_s, end_s: times of the measurements in the session [s].
        force_n: force in the world [N].
        interval_n: half width of the 95 % interval of each component [N].
        mass_g: that the component along gravity carries [g].
        mass_interval_g: half width of its 95 % interval [g].
        converged: False where no force explains the tip.
        measurements: number of measurements of the tip.
    """

    start_s: float
    end_s: float
    force_n: tuple[float, float, float]
    interval_n: tuple[float, float, float]
    mass_g: float
    mass_interval_g: float
    converged: bool
    measurements: int


def rod_of(loaded: LoadedFile, name: str | None) -> tuple[str, Cosserat]:
    """The arm whose load is estimated.

    Raises:
        CalibrationError: there is none, or no such one, or a choice is needed.
    """
    return chosen_robot(loaded, name, Cosserat, "robot", "a load is estimated for model cosserat only")


def session_calibration(
    session: Session, name: str, robot: Cosserat, noise_m: float, reported: bool = False
) -> LoadCalibration:
    """Calibrate from a session in which the arm rested without load at many pressures.

    Args:
        session: session with measured tips.
        name: name of the arm.
        robot: its description.
        noise_m: standard deviation of one measured tip [m].
        reported: True to use what the regulators reported, as the tick does, instead of the commands.

    Raises:
        CalibrationError: too few rests with measured tips, or no reports of a regulator.
    """
    found = list(rests(session, name, robot, build_model(robot)))
    if not found:
        raise CalibrationError(f"{session.path}: {name} never rests with measured tips")
    if reported and any(math.isnan(value) for each in found for value in each.reported):
        raise CalibrationError(f"{session.path}: {name} has a rest in which a regulator reports no pressure")
    noise = noise_m / float(np.sqrt(min(len(each.tips) for each in found)))
    return calibrate_without_load(
        rod_family(robot),
        np.array([each.reported if reported else each.actuation for each in found]),
        np.array([each.side for each in found]),
        np.array([each.tips.mean(axis=0) for each in found]),
        noise,
        Drifts.of([(each.times_s - each.since_s, each.tips) for each in found], noise_m),
    )


def session_loads(
    session: Session, name: str, robot: Cosserat, calibration: LoadCalibration, noise_m: float
) -> Iterator[RestLoad]:
    """The load at every rest of a session, each by itself."""
    frame = BaseFrame.of(robot.base)
    for each in rests(session, name, robot, calibration.model):
        span_s = float(each.times_s[-1] - each.times_s[0]) + 1.0
        estimator = LoadEstimator(calibration, noise_m, span_s)
        for t_s, tip in zip(each.times_s.tolist(), each.tips.tolist(), strict=True):
            estimator.add_at(t_s, each.actuation, each.side, (tip[0], tip[1], tip[2]), t_s - each.since_s)
        found = estimator.estimate()
        assert found is not None, "a rest has measurements"
        rotation = np.array(frame.rotation).reshape(3, 3)
        spread = rotation @ found.covariance @ rotation.T
        half = (NORMAL_95 * np.sqrt(np.diag(spread))).tolist()
        along, interval = found.along(robot.down_in_base)
        yield RestLoad(
            float(each.times_s[0]),
            float(each.times_s[-1]),
            frame.vector_in_world(found.force_n),
            (half[0], half[1], half[2]),
            along / STANDARD_GRAVITY * 1e3,
            interval / STANDARD_GRAVITY * 1e3,
            found.converged,
            found.measurements,
        )
