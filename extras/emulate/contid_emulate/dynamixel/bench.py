"""Emulated servos for one bus of a robot file: ``contid emulate dynamixel``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Final

import numpy as np

from contid.hal import AxisOnBus, SpooledTendon
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.models import BY_NAME
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions, SingleTurn, Tensioning
from contid_emulate.dynamixel.body_tendons import BodyTendons, Spool
from contid_emulate.dynamixel.servo import Servo
from contid_emulate.dynamixel.tendon_friction import FrictionPlant
from contid_emulate.dynamixel.tendons import TendonPlant
from contid_emulate.dynamixel.wire import DynamixelEmulator

#: Stiffness of an emulated tendon on its own, soft because a backbone yields when its tendons are pulled.
MA_PER_TICK: Final = 0.2
#: Current per torque of an XL330-M288: 1.47 A at its stall torque, 0.52 N m.
MA_PER_NM: Final = 1470.0 / 0.52
#: Rotation by which a tendon is slack at power-up.
SLACK_RAD: Final = math.radians(20.0)
#: Distance of the mechanical stops beyond the travel of the robot file.
BEYOND_TRAVEL_RAD: Final = math.radians(10.0)


def servo_of(axis: AxisOnBus, baud: int) -> Servo:
    """The servo of an axis: parked at its stored pose, or in the first turn of its travel.

    Without homing its count at power-up, 0 to 360 degrees, must lie inside its travel to be right.
    """
    options = axis.options
    assert isinstance(options, DynamixelAxisOptions)
    low, high = axis.travel or (-math.inf, math.inf)
    start = low + min(math.pi, 0.5 * (high - low)) if math.isfinite(low) else math.pi
    if options.homing is None and max(low, 0.0) < min(high, math.tau):
        start = 0.5 * (max(low, 0.0) + min(high, math.tau))
    if isinstance(options.homing, SingleTurn):
        start = math.radians(options.homing.pose_deg)
    if isinstance(options.homing, Tensioning):
        # Slack; tendons are taut at 0, also where a homing wrote a zero of the turn the count began in.
        start = -options.homing.direction * SLACK_RAD
        if math.isfinite(low):
            turn = math.tau * round(0.5 * (low + high) / math.tau)
            low, high = low - turn, high - turn
    stops = (low - BEYOND_TRAVEL_RAD) / reg.RAD_PER_TICK, (high + BEYOND_TRAVEL_RAD) / reg.RAD_PER_TICK
    return Servo(
        options.id,
        baud=baud,
        model=BY_NAME[options.model].number,
        position_ticks=float(round(start / reg.RAD_PER_TICK)),
        stops_ticks=stops,
    )


def tendons_of(servos: Sequence[Servo], axes: Sequence[AxisOnBus]) -> tuple[TendonPlant, ...]:
    """Tendons on the spools of axes whose homing tensions them, taut in the servo's zero: a plant per robot.

    Without stiffness in the robot file, or on other buses too, tendons are on their own.
    """
    robots: dict[str, list[tuple[Servo, int, SpooledTendon | None]]] = {}
    for servo, axis in zip(servos, axes, strict=True):
        options = axis.options
        if isinstance(options, DynamixelAxisOptions) and isinstance(options.homing, Tensioning):
            robot = axis.name.partition(".")[0]
            robots.setdefault(robot, []).append((servo, options.homing.direction, axis.tendon))
    return tuple(_plant(found) for found in robots.values())


def _plant(found: Sequence[tuple[Servo, int, SpooledTendon | None]]) -> TendonPlant:
    """The plant of one robot; in its tube until the switch ``tube`` takes it out."""
    spools, winding = [servo for servo, _, _ in found], [sense for _, sense, _ in found]
    tendons = [tendon for _, _, tendon in found if tendon is not None]
    none = (0.0,) * len(spools)
    if len(tendons) < len(spools):
        return TendonPlant(spools, winding, none, (MA_PER_TICK,) * len(spools))
    stiffness = [each.stiffness_nm * MA_PER_NM * reg.RAD_PER_TICK for each in tendons]
    wound = np.array([each.bends for each in tendons]) * np.array(winding)[:, None] / reg.RAD_PER_TICK
    bending = [value * MA_PER_NM / reg.RAD_PER_TICK for value in tendons[0].bending_nm]
    if np.linalg.matrix_rank(wound) < len(bending):  # only some of the robot's tendons
        return TendonPlant(spools, winding, none, stiffness)
    plant: TendonPlant
    backlash = [each.backlash_rad / reg.RAD_PER_TICK for each in tendons]
    if any(backlash) or tendons[0].capstan:
        capstan = tendons[0].capstan or (0.0,) * (len(bending) // 2)
        plant = FrictionPlant(
            spools, winding, none, stiffness, wound, bending, backlash_ticks=backlash, capstan=capstan
        )
    else:
        plant = TendonPlant(spools, winding, none, stiffness, wound, bending)
    plant.held = True
    return plant


class Bench:
    """Context manager that serves the bus at the port of the robot file."""

    def __init__(
        self, name: str, options: DynamixelBusOptions, axes: Sequence[AxisOnBus], control: Path | None = None
    ) -> None:
        self._name = name
        self._control = control
        self._axes = tuple(axes)
        self._pulling: list[BodyTendons] = []
        servos = [servo_of(axis, options.baud) for axis in axes]
        self.emulator = DynamixelEmulator(servos, options.port, control)
        self.emulator.tendons = tendons_of(servos, axes)

    def __enter__(self) -> Sequence[str]:
        """Start; returns a description of the bus."""
        self.emulator.start()
        ids = ", ".join(str(servo.device) for servo in self.emulator.servos)
        lines = [f"{self._name}: {self.emulator.port}, servos {ids}"]
        if self._control is not None:
            lines.append(f"{self._name}: fault switches from {self._control}, one JSON object per line")
        return lines

    def actuators(self, now_s: float) -> dict[str, float]:
        """Where the shafts are [rad] at a time; that of a snapped tendon has unwound it."""
        shafts = self.emulator.shafts(now_s)
        for plant in self._pulling:
            shafts = [
                at + plant.unwound(servo) for at, servo in zip(shafts, self.emulator.servos, strict=True)
            ]
        return {axis.name: at * reg.RAD_PER_TICK for axis, at in zip(self._axes, shafts, strict=True)}

    def carry(self, spools: Sequence[Spool]) -> BodyTendons:
        """The tendons of a moving body, which pull on its spools from now on.

        Servos without a homing stand where the body is at rest, if their first turn has that.
        """
        of_axis = dict(zip([axis.name for axis in self._axes], self.emulator.servos, strict=True))
        servos = [of_axis[spool.axis] for spool in spools]
        options = {axis.name: axis.options for axis in self._axes}
        for servo, spool in zip(servos, spools, strict=True):
            own = options[spool.axis]
            assert isinstance(own, DynamixelAxisOptions)
            if own.homing is None and 0.0 <= spool.rest_rad < math.tau:
                servo.motion.position = servo.motion.goal = spool.rest_rad / reg.RAD_PER_TICK
        mine = {servo.device for servo in servos}
        standing = [plant for plant in self.emulator.tendons if mine & set(plant.devices)]
        plant = BodyTendons(servos, [each.ma_per_n for each in spools], standing[0] if standing else None)
        others = [each for each in self.emulator.tendons if each not in standing]
        self.emulator.tendons = (*others, plant)
        self._pulling.append(plant)
        return plant

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self.emulator.stop()
