"""The force on the tip by least squares over the newest measurements, with its uncertainty.

    minimise  (ybar - hbar(F))^T V^-1 (ybar - hbar(F)) + |F|^2 / prior^2
    V = noise^2/n I + what the calibration left open

by Levenberg-Marquardt with the model's compliance dh/dF. An arm at rest is in a stable equilibrium: a step to
a force under which the model buckles is shortened: beyond it the tip does not depend on the force alone. The
part of V that the calibration left open does not shrink with the number of measurements: more of them average
the tracker, not the error of the model. A pure function of its inputs: the same measurements give the same
estimate.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from contid.kinematics.array import Array
from contid.targets import Actuation, Vec3, vec3
from contid_fit.sense.calibration import LoadCalibration
from contid_fit.sense.creep import REFERENCE_S, decades_of
from contid_fit.sense.play import HysteresisSides

#: Two-sided 95 % of the normal distribution.
NORMAL_95: Final = 1.959964
_ITERATIONS: Final = 40
#: A command, the sides of the hysteresis there, and decades of its age.
_Pose: TypeAlias = tuple[Actuation, Actuation, float]
#: Ages that differ by less than this part of a decade are one.
_DECADES: Final = 0.02
_TRIALS: Final = 12
_STEP_N: Final = 1e-6
_ROUNDED_STEP_N: Final = 1e-3


@dataclass(frozen=True, eq=False, slots=True)
class LoadEstimate:
    """A force on the tip in the base frame.

    Attributes:
        force_n: x, y, z [N].
        covariance: covariance of the force, shape ``(3, 3)`` [N^2]; that before any measurement where the
            iteration did not end.
        converged: the iteration ended; False also where the arm buckles without a load.
        measurements: that it is from.
    """

    force_n: Vec3
    covariance: Array
    converged: bool
    measurements: int

    @property
    def interval_n(self) -> Vec3:
        """Half width of the 95 % interval of every component [N]."""
        return vec3((NORMAL_95 * np.sqrt(np.diag(self.covariance))).tolist())

    def along(self, direction: Vec3) -> tuple[float, float]:
        """Component along a direction [N] and half width of its 95 % interval."""
        unit = np.array(direction) / np.linalg.norm(direction)
        half = NORMAL_95 * float(np.sqrt(unit @ self.covariance @ unit))
        return float(unit @ np.array(self.force_n)), half


class LoadEstimator:
    """A window of measurements, and the force that explains them.

    Args:
        calibration: the model of the arm and its error without load.
        noise_m: standard deviation of one measured tip, per component [m].
        window_s: time that the estimate looks back [s].
        prior_n: standard deviation of a component of the load before any measurement [N].
    """

    def __init__(
        self,
        calibration: LoadCalibration,
        noise_m: float = 3e-4,
        window_s: float = 1.0,
        prior_n: float = 0.2,
    ) -> None:
        self._calibration = calibration
        self._noise_m = noise_m
        self._window_s = window_s
        self._prior_n = prior_n
        self._play = HysteresisSides(calibration.model)
        self._window: deque[tuple[float, _Pose, Vec3]] = deque()
        self._force = np.zeros(3)

    def add(self, t_s: float, actuation: Actuation, tip_in_base_m: Vec3, age_s: float = REFERENCE_S) -> None:
        """A measurement ``age_s`` after the last change of a command; older ones than the window go.

        Raises:
            ValueError: time does not grow.
        """
        self.add_at(t_s, actuation, self.command(actuation), tip_in_base_m, age_s)

    def add_at(
        self,
        t_s: float,
        actuation: Actuation,
        side: Actuation,
        tip_in_base_m: Vec3,
        age_s: float = REFERENCE_S,
    ) -> None:
        """The same with the sides of the hysteresis already known (`contid_fit.sense.play`).

        Raises:
            ValueError: time does not grow.
        """
        if self._window and t_s <= self._window[-1][0]:
            raise ValueError(f"measurement at {t_s:g} s after one at {self._window[-1][0]:g} s")
        decades = _DECADES * round(decades_of(age_s) / _DECADES) if self._calibration.creep.sigma else 0.0
        self._window.append((t_s, (actuation, side, decades), tip_in_base_m))
        while self._window[0][0] <= t_s - self._window_s:
            self._window.popleft()

    def command(self, actuation: Actuation) -> Actuation:
        """A command [m or Pa] on the way, without a measurement: it decides the side of the hysteresis."""
        return self._play.to(actuation)

    def clear(self) -> None:
        """Forget the window, as after a change of the load or a motion."""
        self._window.clear()
        self._force = np.zeros(3)

    def estimate(self) -> LoadEstimate | None:
        """The force that explains the window; None without a measurement."""
        if not self._window:
            return None
        # One model evaluation per distinct actuation: while an arm rests there is one.
        groups: dict[_Pose, list[Vec3]] = {}
        for _, pose, tip in self._window:
            groups.setdefault(pose, []).append(tip)
        count = len(self._window)
        newest = self._window[-1][1]
        measured = np.mean([tip for _, _, tip in self._window], axis=0)
        corrected = {pose: self._calibration.corrected(*pose[:2]) for pose in groups}
        models = {decades: self._calibration.aged(decades) for _, _, decades in groups}
        model = models[newest[2]]
        prior = np.eye(3) / self._prior_n**2

        def missed(force: Array) -> Array | None:
            load, tips = vec3(force.tolist()), []
            for pose, group in groups.items():
                reached = models[pose[2]].forward(corrected[pose], load)
                if not reached.stable:
                    return None
                tips.append(len(group) * np.array(reached.tip_m))
            error: Array = measured - np.sum(tips, axis=0) / count
            return error

        def descent(force: Array) -> tuple[Array, Array | None]:
            """The force of least cost, and its information; None where the way there ends short of it."""
            error, damping = missed(force), 0.0
            for _ in range(_ITERATIONS):
                if error is None:
                    break
                load = vec3(force.tolist())
                jacobian = model.jacobian(corrected[newest], load)
                compliance = model.compliance(corrected[newest], load)
                spread = self._noise_m**2 / count * np.eye(3)
                spread += self._calibration.tip_covariance(*newest[:2], load, jacobian, newest[2])
                weight = np.linalg.inv(spread)
                information = np.asarray(compliance.T @ weight @ compliance + prior, dtype=np.float64)
                downhill = compliance.T @ weight @ error - prior @ force
                cost = error @ weight @ error + force @ prior @ force
                left = float(np.linalg.norm(np.linalg.solve(information, downhill)))
                for _ in range(_TRIALS):
                    damped = information + damping * np.diag(np.diag(information))
                    trial = force + np.linalg.solve(damped, downhill)
                    trial_error = missed(trial)
                    if (
                        trial_error is not None
                        and trial_error @ weight @ trial_error + trial @ prior @ trial <= cost
                    ):
                        damping *= 0.2
                        break
                    damping = max(4.0 * damping, 0.1)
                else:
                    # The cost is at the rounding of the model; a step that is still long is a failure.
                    return force, information if left < _ROUNDED_STEP_N else None
                force, error = trial, trial_error
                if left < _STEP_N:  # without damping, which makes any step short
                    return force, information
            return force, None

        force, information = descent(self._force)
        if information is None and self._force.any():  # it may be of other pressures
            force, information = descent(np.zeros(3))
        converged = information is not None
        self._force = force if converged else np.zeros(3)
        covariance = np.asarray(
            np.linalg.inv(prior if information is None else information), dtype=np.float64
        )
        return LoadEstimate(vec3(force.tolist()), covariance, converged, count)
