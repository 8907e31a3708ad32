"""The moving body of a simulated robot, which the simulated bus carries where ``sim`` has ``dynamics: true``.

Between the actuators of the simulated devices and the body stand the dead time and the lag of ``dynamics``,
for pneumatic arms also the errors and the hysteresis of ``sim.errors``. Steps are as long as the time between
two looks of the bus, at most `STEP_S`, so that a run in virtual time is the same to the bit.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np

from contid.control.tick.transmission import axis_map
from contid.kinematics.array import Array
from contid.kinematics.frames import BaseFrame
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.tendon.robot import TendonRobot
from contid.targets import Vec3, vec3
from contid.units import BAR
from contid_dynamics.arm import MovingArm

#: Longest step of the body.
STEP_S: Final = 2e-3
#: A new actuation from rest is approached in this many parts.
_PARTS: Final = 16


class MovingBody:
    """The tip of one robot in motion over what its actuators do.

    Args:
        robot: description with ``dynamics`` and ``sim``.

    Attributes:
        lost: a step had no answer; the body stays where it was.
    """

    def __init__(self, robot: Cosserat | TendonRobot) -> None:
        assert robot.sim is not None
        self._robot = _with_errors(robot)
        self._sim = robot.sim
        self._frame = BaseFrame.of(robot.base)
        self._payload_kg = self._sim.payload_kg(0.0)
        self._arm = MovingArm(self._robot, self._payload_kg)
        count = len(robot.axis_names)
        self._actuators = _Actuators(robot, count)
        self._time_s: float | None = None
        self.lost = False

    def follow(self, actuators: list[float], t_s: float) -> None:
        """The actuators reached pressures [Pa] or angles of shafts [rad]; the body moves on to ``t_s``.

        A payload is put on and taken off without a push.
        """
        if self._time_s is None:
            self._time_s = t_s
            acting = self._actuators.begin(actuators, t_s)
            try:
                self._arm.settle(acting, steps=_PARTS)
            except ArithmeticError:
                self.lost = True
            return
        if (payload_kg := self._sim.payload_kg(t_s)) != self._payload_kg:
            self._payload_kg = payload_kg
            strain = self._arm.rod.strain
            self._arm = MovingArm(self._robot, payload_kg)
            self._arm.rod.put(strain)
        steps = max(0, math.ceil((t_s - self._time_s) / STEP_S - 1e-9))
        step_s = (t_s - self._time_s) / max(steps, 1)
        for part in range(1, steps + 1):
            now_s = self._time_s + (t_s - self._time_s) * part / steps
            self._arm.command(self._actuators.act(actuators, now_s), within_s=step_s)
            try:
                self._arm.rod.run(step_s, step_s)
            except ArithmeticError:
                self.lost = True
        self._time_s = t_s

    def tip_in_world_m(self, t_s: float) -> tuple[float, float, float]:
        """Where the tip is [m]; ``t_s`` is the time of the last `follow`."""
        tip: Vec3 = vec3(self._arm.tip_m.tolist())
        return self._frame.point_in_world(tip)

    def tensions_n(self) -> tuple[float, ...]:
        """With what each tendon pulls on its actuator, 0 where it is slack; empty without tendons."""
        return tuple(self._arm.rod.tensions_n.tolist())


class _Actuators:
    """From what devices report to what acts on the body: units, errors, dead time, lag."""

    def __init__(self, robot: Cosserat | TendonRobot, count: int) -> None:
        assert robot.dynamics is not None
        self._robot = robot
        self._delay_s = np.array([1e-3 * each for each in per_axis(robot.dynamics.delay_ms, count)])
        self._lag_s = np.array([1e-3 * each for each in per_axis(robot.dynamics.lag_ms, count)])
        self._offset, self._half = np.zeros(count), 0.0
        if isinstance(robot, Cosserat):
            assert robot.sim is not None
            errors = robot.sim.errors
            self._offset = BAR * np.array(errors.regulator_offsets_bar(count))
            self._half = 0.5 * errors.hysteresis_bar * BAR
        wirings = [robot.axes[axis] for axis in robot.axis_names]
        # Pressures act as they are reported; a shaft acts by the length of its tendon.
        self._of_shaft = [axis_map(each)[1] for each in wirings] if isinstance(robot, TendonRobot) else []
        self._at_once = not self._delay_s.any() and not self._lag_s.any()
        self._past: deque[tuple[float, Array]] = deque()

    def begin(self, reported: Sequence[float], now_s: float) -> list[float]:
        """The devices have reported this for ever."""
        given = self._in_si(reported)
        self._past.append((-math.inf, given))
        self._lagged, self._held, self._now_s = given, given, now_s
        return self._acting()

    def act(self, reported: Sequence[float], now_s: float) -> list[float]:
        """What acts at a time [m or Pa], with what the devices reported last."""
        given = self._in_si(reported)
        if self._at_once:
            self._lagged = given
        else:
            self._past.append((now_s, given))
            due = np.array([self._at(now_s - delay)[k] for k, delay in enumerate(self._delay_s)])
            longest = float(self._delay_s.max())
            while len(self._past) > 1 and self._past[1][0] <= now_s - longest:
                self._past.popleft()
            with np.errstate(divide="ignore"):
                share = np.where(self._lag_s > 0.0, -np.expm1(-(now_s - self._now_s) / self._lag_s), 1.0)
            self._lagged = self._lagged + share * (due - self._lagged)
        if self._half:
            self._held = np.clip(self._held, self._lagged - self._half, self._lagged + self._half)
        else:
            self._held = self._lagged
        self._now_s = now_s
        return self._acting()

    def _at(self, time_s: float) -> Array:
        found = self._past[0][1]
        for at_s, values in self._past:
            if at_s > time_s:
                break
            found = values
        return found

    def _acting(self) -> list[float]:
        acting: list[float] = (self._held + self._offset).tolist()
        return [max(0.0, each) for each in acting] if isinstance(self._robot, Cosserat) else acting

    def _in_si(self, reported: Sequence[float]) -> Array:
        if not self._of_shaft:
            return np.array(reported, dtype=np.float64)
        return np.array([of(each) for of, each in zip(self._of_shaft, reported, strict=True)])


def per_axis(values: tuple[float, ...], count: int) -> tuple[float, ...]:
    """Numbers of ``dynamics`` for every axis: one stands for all."""
    return values * count if len(values) == 1 else values


def _with_errors(robot: Cosserat | TendonRobot) -> Cosserat | TendonRobot:
    """The robot that is simulated: its modulus and moments differ from the file by ``sim.errors``."""
    if not isinstance(robot, Cosserat):
        return robot
    assert robot.sim is not None
    errors = robot.sim.errors
    sections = []
    for k, section in enumerate(robot.geometry.sections):
        scale = errors.modulus_scale(k)
        sections.append(
            section.model_copy(
                update={
                    "modulus_pa": tuple(scale * b for b in section.modulus_pa),
                    "bending_gain": section.bending_gain * errors.moment_scale,
                }
            )
        )
    geometry = robot.geometry.model_copy(update={"sections": tuple(sections)})
    return robot.model_copy(update={"geometry": geometry, "sense": None})
