"""Contacts of the tip of a pneumatic arm: an unexpected force, from its measured tips.

The test is independent of the load estimate and its gate: the model is evaluated under the load that was
known before, because an estimate that follows the contact would hide it. A measurement costs one call of the
kernel, in the tick in which it arrives. The result depends on the inputs only, so a replay finds the same.

The pressure of an axis and the bend it causes form a hysteresis loop. The side, -1 to 1, is the place of the
axis between the two branches of its loop; it is open (unknown) until the axis has moved through its loop.
"""

from __future__ import annotations

import math
from collections import deque
from copy import copy
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.control.tick.tip_feedback import Measurement
from contid.kinematics.array import Array
from contid.kinematics.frames import BaseFrame
from contid.robot_file.cosserat import Cosserat
from contid.targets import Vec3, vec3
from contid.units import MM_PER_M
from contid_fit.identified_arm import IdentifiedArm, Numbers
from contid_fit.sense.live.innovation_test import (
    NEWEST,
    REFERENCE,
    Departure,
    InnovationTest,
    TipResidual,
)
from contid_fit.sense.live.known_load import KnownLoad
from contid_fit.sense.live.load_observer import LoadFound
from contid_fit.sense.live.pressure_trace import PressurePose, PressureTrace
from contid_fit.sense.live.swing import BodySwing
from contid_fit.sense.play import ON_BRANCH

#: This long after a contact the present load becomes the known one [s].
REARM_S: Final = 1.0
#: Standard deviation of the side of an axis between the branches of its loop, in units of half the loop.
_SIDE_SIGMA: Final = 0.15
#: Prior standard deviation of a component of a contact's force [N]: small, so that the stiff direction of the
#: arm, in which noise looks like a large force, does not determine the direction.
_EXPECTED_N: Final = 1e-3
#: Factor on the standard deviations of the load estimate, which lags behind a moving arm.
_ESTIMATE_FACTOR: Final = 2.0
#: A measurement within this squared distance of the load before the contact shows that the contact has ended.
_ENDED: Final = 16.0


@dataclass(frozen=True, slots=True)
class TipContactFound:
    """An unexpected force on a tip.

    Attributes:
        time_s: capture of the measurement that showed it, in the time of the tick.
        direction_in_base: direction of the force, a unit vector.
        force_n: its size at that time [N].
        confidence: 1 minus the expected number of such findings without a contact in an hour.
    """

    time_s: float
    direction_in_base: Vec3
    force_n: float
    confidence: float


class TipContact:
    """The detector of one arm.

    Args:
        robot: its description, with a ``sense``.
        arm: its model with the error that was identified.
        swing: that of the load estimate, which also sees the measurements before a load is known.
    """

    def __init__(self, robot: Cosserat, arm: IdentifiedArm, swing: BodySwing) -> None:
        assert robot.sense is not None
        sensing = robot.sense.load
        _rehearse(sensing.noise_mm)
        self._arm = arm
        self._frame = BaseFrame.of(robot.base)
        self._loop = np.array(sensing.calibration.loop_bar)
        self._axis_sigma = sensing.calibration.axis_sigma_bar
        self._test = InnovationTest(sensing.noise_mm)
        self._swing_before, self._swing = swing, copy(swing)
        self._known: KnownLoad | None = None
        #: The known load before the newest contact.
        self._before: KnownLoad | None = None
        self._side_open: Numbers | None = None
        self._used_s = -math.inf
        #: Time of the newest contact, or of another reason to discard the known load [s].
        self._since_s = -math.inf
        #: Base moment of the newest equilibrium [N·mm], from which the next one is solved.
        self._moment: Numbers | None = None
        self._poses: deque[tuple[float, Array]] = deque(maxlen=3)

    @property
    def armed(self) -> bool:
        """True when a contact would be found."""
        return self._known is not None and self._test.armed

    @property
    def distance(self) -> float:
        """Squared distance of the newest residuals from what is expected; a contact beyond its gate."""
        return self._test.distance

    def tick(
        self, trace: PressureTrace, measurement: Measurement | None, load: LoadFound | None
    ) -> TipContactFound | None:
        """A contact that the newest measurement shows.

        Args:
            trace: history of the pressures, up to this tick.
            measurement: newest measured tip there is.
            load: newest estimate of the load.
        """
        if measurement is None or measurement.time_s <= self._used_s:
            return None
        gap_s = measurement.time_s - self._used_s
        self._used_s = measurement.time_s
        pose = trace.at(measurement.time_s)
        open_ = None if pose is None else pose.side_open
        if gap_s > REARM_S or open_ != self._side_open:
            # The side of an axis became known: the error of the model is another one than before.
            self._forget()
            self._since_s = measurement.time_s
        self._side_open = open_
        known = self._load(load)
        if pose is None or known is None:
            return None
        return self._compared(measurement, pose, known, gap_s)

    def _forget(self) -> None:
        self._known, self._moment = None, None
        self._poses.clear()
        self._test.clear()

    def _load(self, estimate: LoadFound | None) -> KnownLoad | None:
        """The known load; it begins with a settled estimate, `REARM_S` after the last contact."""
        rested = self._used_s - self._since_s >= REARM_S
        if self._known is None and estimate is not None and estimate.settled and rested:
            spread = _ESTIMATE_FACTOR**2 * np.array(estimate.covariance).reshape(3, 3)
            self._known = KnownLoad(np.array(estimate.force_in_base), spread)
        return self._known

    def _compared(
        self, measurement: Measurement, pose: PressurePose, load: KnownLoad, gap_s: float
    ) -> TipContactFound | None:
        corrected = self._arm.corrected(pose.pressures, pose.sides)
        known = vec3(load.force.tolist())
        if self._moment is None:
            self._moment = self._arm.base_moment(corrected, known)
        here = None if self._moment is None else self._arm.near(corrected, known, self._moment)
        if here is None:
            self._forget()
            return None
        if not self._poses:
            # The body may swing from motions that were not compared.
            self._swing.go_on_from(self._swing_before)
        self._moment = here.base_moment_nmm
        seen = MM_PER_M * np.array(self._frame.point_in_base(measurement.tip_in_world))
        by_force, by_pressure = (
            np.array(here.by_force_mm_n).reshape(3, 3),
            np.array(here.by_pressure_mm_bar).reshape(3, -1),
        )
        residual = TipResidual(
            residual_mm=seen - np.array(here.tip_mm),
            velocity=by_pressure @ self._rate(measurement.time_s, np.array(pose.pressures)),
            by_pressure=by_pressure,
            shared=self._of_pose(pose, by_pressure),
            by_force=by_force,
            load_covariance=load.covariance,
            swing_mm=self._swing.to(measurement.time_s, np.array(pose.pressures), by_pressure),
        )
        found = self._test.add(residual)
        if found is None:
            if self._test.confirms:
                self._test.reload(load.follow(*self._test.confirmed, gap_s))
            return None
        if self._ended(corrected, seen, residual):
            return None
        return self._contact(measurement.time_s, found, by_force, load)

    def _rate(self, time_s: float, pressures: Array) -> Array:
        """Velocity of the pressures over the newest measurements [bar/s]."""
        self._poses.append((time_s, pressures))
        since_s = time_s - self._poses[0][0]
        rate: Array = (pressures - self._poses[0][1]) / since_s if since_s > 0.0 else 0.0 * pressures
        return rate

    def _of_pose(self, pose: PressurePose, by_pressure: Array) -> Array:
        """Covariance of the tip by axes between the branches of their loops and by the calibration [mm^2]."""
        between = np.abs(pose.sides) < ON_BRANCH
        columns = by_pressure * np.hypot(np.where(between, _SIDE_SIGMA * self._loop, 0.0), self._axis_sigma)
        spread: Array = columns @ columns.T
        return spread + self._arm.sides_mm2(pose.side_open, by_pressure)

    def _ended(self, corrected: Numbers, seen: Array, residual: TipResidual) -> bool:
        """True when the load is again that before the newest contact: then this is no new contact."""
        before = self._before
        moment = None if before is None else self._arm.base_moment(corrected, vec3(before.force.tolist()))
        if before is None or moment is None:
            return False
        here = self._arm.near(corrected, vec3(before.force.tolist()), moment)
        if here is None:
            return False
        by_force = np.array(here.by_force_mm_n).reshape(3, 3)
        residual_mm = seen - np.array(here.tip_mm)
        spread: Array = self._test.noise(residual) + by_force @ before.covariance @ by_force.T
        if float(residual_mm @ np.linalg.solve(spread, residual_mm)) > _ENDED:
            return False
        self._forget()
        self._known, self._before, self._moment = before, None, here.base_moment_nmm
        return True

    def _contact(self, time_s: float, found: Departure, by_force: Array, load: KnownLoad) -> TipContactFound:
        weight = np.asarray(np.linalg.inv(found.covariance), dtype=np.float64)
        information: Array = by_force.T @ weight @ by_force + np.eye(3) / _EXPECTED_N**2
        force = np.linalg.solve(information, by_force.T @ weight @ found.shift_mm)
        size = float(np.linalg.norm(force))
        self._forget()
        self._since_s, self._before = time_s, load
        return TipContactFound(time_s, vec3((force / size).tolist()), size, found.confidence)


def _rehearse(noise_mm: float) -> None:
    """Make every call once: the first ones take milliseconds."""
    test, slopes = InnovationTest(noise_mm), np.ones((3, 6))
    load = KnownLoad(np.zeros(3), np.eye(3))
    for number in range(NEWEST + REFERENCE + 2):
        residual_mm = np.array([0.01 * (number % 2), 0.0, 0.0])
        test.add(TipResidual(residual_mm, residual_mm, slopes, np.zeros((3, 3)), np.eye(3), np.eye(3)))
    test.reload(load.follow(*test.confirmed, 0.02))
