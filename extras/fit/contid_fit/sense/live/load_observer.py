"""Estimates the force on the tip of one arm, a bounded piece of work in every tick.

A measurement is compared with the model at the pressures that the regulators reported around its capture.
The kernel is called once per tick, or a few times when ticks are slow; a few ticks later the measurement is
in the estimate. The covariance of the model is renewed between measurements. The estimate depends on the
inputs only, so a replay finds the same.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from contid.control.tick.tip_feedback import Measurement
from contid.kinematics.array import Array
from contid.kinematics.cosserat.engine import NearAnswer
from contid.kinematics.frames import BaseFrame
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.pneumatic.sense import LoadSensing
from contid.targets import ZERO3, Vec3, vec3
from contid.units import MM_PER_M, STANDARD_GRAVITY
from contid_fit.identified_arm import IdentifiedArm, Numbers
from contid_fit.sense.creep import decades_of
from contid_fit.sense.live.load_filter import LoadFilter
from contid_fit.sense.live.pressure_trace import PressurePose, PressureTrace
from contid_fit.sense.live.swing import BodySwing, NoSwing, swing_of

#: Forces that are tried per measurement.
TRIALS: Final = 4
#: Multiples of the estimated force under which the stability of the arm is examined: while it is stable under
#: the first, the solver may keep this force as its load; under the second, it may take a larger one.
MARGIN: Final = (1.25, 1.5)
#: Calls of the kernel per second of ticks; slower ticks make more calls each.
CALLS_HZ: Final = 500.0
#: Covariance of the model: renewed after a change of a pressure [bar] or of the force [N].
_MOVED_BAR: Final = 0.01
_MOVED_N: Final = 0.002

#: An arm creeps no longer than this [s].
LONGEST_S: Final = 1e5
_NONE: Final = np.zeros((3, 3))
_Work: TypeAlias = Generator[None, None, None]


@dataclass(frozen=True, slots=True)
class LoadFound:
    """The force on a tip.

    Attributes:
        time_s: capture of the newest measurement in it, in the time of the tick.
        force_in_base: [N].
        covariance: covariance of the force, row-major [N^2].
        settled: the average is as long as its time constant.
        held, margin: the arm is stable under 1.25 and 1.5 times this force; False where that was not
            examined.
    """

    time_s: float
    force_in_base: Vec3
    covariance: tuple[float, ...]
    settled: bool
    held: bool
    margin: bool


class LoadObserver:
    """The estimate of one arm.

    Args:
        robot: its description, with a ``sense``.
        period_s: period of the tick.

    Attributes:
        arm: model of the arm with its identified errors.
        trace: the pressures of the newest ticks.
    """

    def __init__(self, robot: Cosserat, period_s: float) -> None:
        assert robot.sense is not None
        _rehearse(_Estimation(robot, robot.sense.load, period_s, NoSwing()), len(robot.axis_names))
        #: How far the body may swing, from every measurement on.
        self.swing = swing_of(robot)
        self._estimation = _Estimation(robot, robot.sense.load, period_s, self.swing)
        self.arm, self.trace = self._estimation.arm, self._estimation.trace
        # The estimation must not hold its own generator: such a ring outlives the process's clean-up.
        self._work = self._estimation.forever()
        self._calls = max(1, math.ceil(CALLS_HZ * period_s))

    @property
    def found(self) -> LoadFound | None:
        """Newest estimate, None before the first."""
        return self._estimation.found

    def tick(
        self,
        now_s: float,
        reported_bar: Numbers | None,
        commands_bar: Numbers | None,
        measurement: Measurement | None,
    ) -> None:
        """Do the work of one tick.

        Args:
            now_s: its time.
            reported_bar: newest pressures of the regulators; None when one is invalid.
            commands_bar: pressures commanded in the tick before; None when there were none.
            measurement: newest measured tip; the same one until another arrives.
        """
        self.trace.tick(now_s, reported_bar, commands_bar)
        self._estimation.commanded(now_s, commands_bar)
        self._estimation.newest = measurement
        for _ in range(self._calls):
            next(self._work)


class _Estimation:
    """The work between two measurements, in parts of about the same time between its yields."""

    def __init__(self, robot: Cosserat, sensing: LoadSensing, period_s: float, swing: BodySwing) -> None:
        self._swing = swing
        self.arm = IdentifiedArm(robot)
        self._frame = BaseFrame.of(robot.base)
        self._filter = LoadFilter(
            sensing.noise_mm, sensing.window_s, sensing.expected_g * 1e-3 * STANDARD_GRAVITY
        )
        self.trace = PressureTrace(self.arm.half_loop, period_s)
        self.newest: Measurement | None = None
        self._used_s = -math.inf
        self._moment: Numbers = (0.0, 0.0, 0.0)
        self._model: Array | None = None
        self._by_scale = np.zeros((3, self.arm.scales))
        self._commands: Numbers | None = None
        self._since_s = -math.inf
        self._model_at: tuple[Numbers, Array] = ((), np.zeros(3))
        self._checks_margin = robot.load == "estimated"
        self.found: LoadFound | None = None

    def commanded(self, now_s: float, commands_bar: Numbers | None) -> None:
        """The commands of a tick, which decide the age of the pose; it is old before they change."""
        if commands_bar != self._commands:
            if self._commands is not None:
                self._since_s = now_s
            self._commands = commands_bar

    def forever(self) -> _Work:
        """Take every measurement when it arrives, and renew the covariance of the model between them."""
        while True:
            measurement = self.newest
            if measurement is None or measurement.time_s <= self._used_s:
                yield
                continue
            self._used_s = measurement.time_s
            pose = self.trace.at(measurement.time_s)
            yield
            if pose is None:
                continue
            if self._model is None:
                yield from self._renew(pose)
            if self._model is not None:
                yield from self._take(measurement, pose)
                if self._changed(pose):
                    yield from self._renew(pose)

    def _take(self, measurement: Measurement, pose: PressurePose) -> _Work:
        """Bring a measurement into the estimate."""
        corrected = self.arm.corrected(pose.pressures, pose.sides)
        equilibrium = self.arm.near(corrected, vec3(self._filter.force.tolist()), self._moment)
        if equilibrium is None:
            yield
            equilibrium = self._again(corrected)
            if equilibrium is None:
                self._filter.restart(0.5 * self._filter.force)  # back to where the arm is stable
                yield
                return
        assert self._model is not None
        model, crept_mm = self._model, np.zeros(3)
        if self.arm.creeps:
            age_s = min(measurement.time_s - self._since_s, LONGEST_S)
            crept_mm, spread_mm2 = self.arm.creep_mm(decades_of(age_s), self._by_scale)
            model = model + spread_mm2
        by_pressure = np.array(equilibrium.by_pressure_mm_bar).reshape(3, -1)
        swing_mm = self._swing.to(measurement.time_s, np.array(pose.pressures), by_pressure)
        model = model + swing_mm**2 * np.eye(3)
        if any(pose.late) or any(pose.side_open):
            late = by_pressure @ np.array(pose.late)
            model = model + late[:, None] * late
            if any(pose.side_open):
                model = model + self.arm.sides_mm2(pose.side_open, by_pressure)
        yield
        tip_mm, self._moment = np.array(equilibrium.tip_mm), equilibrium.base_moment_nmm
        measured_mm = MM_PER_M * np.array(self._frame.point_in_base(measurement.tip_in_world)) - crept_mm
        jumped = yield from self._filter.add(
            measurement.time_s, measured_mm - tip_mm, _matrix(equilibrium.by_force_mm_n), model
        )
        if jumped:
            yield
            # Steps never lead back from an equilibrium of another branch: try the unloaded arm as well.
            tip_mm = self._unloaded(corrected, tip_mm)
        for trial in range(TRIALS):
            tried = self._filter.proposed()
            if tried is None:
                break
            if trial or jumped:
                yield
            # A force on the tip has a moment about the base that follows from the tip.
            predicted = _moved(self._moment, tip_mm, tried - self._filter.force)
            tried_equilibrium = self.arm.near(corrected, vec3(tried.tolist()), predicted)
            yield
            if tried_equilibrium is None:
                self._filter.judge(None, _NONE)
            elif self._filter.judge(
                np.array(tried_equilibrium.tip_mm) - tip_mm, _matrix(tried_equilibrium.by_force_mm_n)
            ):
                tip_mm, self._moment = np.array(tried_equilibrium.tip_mm), tried_equilibrium.base_moment_nmm
        spread = tuple(self._filter.covariance.ravel().tolist())
        reached, moment = tip_mm, self._moment
        force = vec3(self._filter.force.tolist())
        stable: list[bool] = []
        if self._checks_margin:
            yield
        for last, part in zip((1.0, *MARGIN), MARGIN, strict=False):
            if not self._checks_margin or not all(stable):
                break
            predicted = _moved(moment, reached, (part - last) * self._filter.force)
            tried_equilibrium = self.arm.near(
                corrected, vec3((part * self._filter.force).tolist()), predicted
            )
            stable.append(tried_equilibrium is not None)
            if tried_equilibrium is not None:
                reached, moment = np.array(tried_equilibrium.tip_mm), tried_equilibrium.base_moment_nmm
        yield
        held, margin = (*stable, False, False)[:2]
        self.found = LoadFound(measurement.time_s, force, spread, self._filter.settled, held, margin)
        yield

    def _unloaded(self, corrected: Numbers, tip: Array) -> Array:
        """The tip of the estimate, which is now the unloaded arm where that explains the jump better."""
        moment = self.arm.base_moment(corrected)
        unloaded = None if moment is None else self.arm.near(corrected, ZERO3, moment)
        if unloaded is not None and self._filter.judge_unloaded(
            np.array(unloaded.tip_mm) - tip, _matrix(unloaded.by_force_mm_n)
        ):
            tip, self._moment = np.array(unloaded.tip_mm), unloaded.base_moment_nmm
        return tip

    def _again(self, corrected: Numbers) -> NearAnswer | None:
        """The equilibrium under the estimated force, reached by continuation from the unloaded arm."""
        force = vec3(self._filter.force.tolist())
        moment = self.arm.base_moment(corrected, force)
        return None if moment is None else self.arm.near(corrected, force, moment)

    def _changed(self, pose: PressurePose) -> bool:
        pressures, force = self._model_at
        moved_bar = max(abs(a - b) for a, b in zip(pressures, pose.pressures, strict=True))
        return moved_bar > _MOVED_BAR or float(np.abs(force - self._filter.force).max()) > _MOVED_N

    def _renew(self, pose: PressurePose) -> _Work:
        """The covariance of the model at a pose; it stays as it was where the arm is unstable."""
        arm, force = self.arm, self._filter.force
        corrected, load = arm.corrected(pose.pressures, pose.sides), vec3(force.tolist())
        equilibrium = arm.near(corrected, load, self._moment)
        yield
        if equilibrium is None:
            equilibrium = self._again(corrected)
            yield
        if equilibrium is None:
            self._filter.restart(0.5 * force)
            return
        columns = []
        for scale in range(arm.scales):
            moved = arm.near(corrected, load, equilibrium.base_moment_nmm, scale)
            if scale % 2:
                yield
            if moved is None:
                return
            columns.append(
                [(a - b) / arm.steps[scale] for a, b in zip(moved.tip_mm, equilibrium.tip_mm, strict=True)]
            )
        yield
        by_pressure = np.array(equilibrium.by_pressure_mm_bar).reshape(3, -1)
        self._moment = equilibrium.base_moment_nmm
        self._by_scale = np.array(columns).T
        self._model = arm.covariance_mm2(pose.pressures, pose.sides, by_pressure, self._by_scale)
        self._model_at = (pose.pressures, force)
        yield


def _rehearse(estimation: _Estimation, axes: int) -> None:
    """Make every call once: the first ones take milliseconds."""
    still, work = (0.5,) * axes, estimation.forever()
    for number in range(20):
        estimation.trace.tick(0.1 * number, still, still)
        estimation.newest = Measurement((0.01 * (number % 2), 0.0, 0.09), 0.1 * number)
        next(work)


def _moved(moment: Numbers, tip: Array, change: Array) -> Numbers:
    """The base moment after a change of the force [N] on a tip that stays where it is [mm]."""
    (a, b, c), (x, y, z), (u, v, w) = moment, tip.tolist(), change.tolist()
    return (a + y * w - z * v, b + z * u - x * w, c + x * v - y * u)


def _matrix(row_major: Numbers) -> Array:
    return np.array(row_major).reshape(3, 3)
