"""Emulated servos for one bus of a robot file: ``contid emulate dynamixel``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Final

from contid.hal import AxisOnBus
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.emulator.servo import Servo
from contid_drivers.dynamixel.emulator.tendons import TendonPlant
from contid_drivers.dynamixel.emulator.wire import DynamixelEmulator
from contid_drivers.dynamixel.models import BY_NAME
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions, SingleTurn, Tensioning

#: Stiffness of an emulated tendon on its own, soft because a backbone yields when its tendons are pulled.
MA_PER_TICK: Final = 0.2
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
    stops = (low - BEYOND_TRAVEL_RAD) / reg.RAD_PER_TICK, (high + BEYOND_TRAVEL_RAD) / reg.RAD_PER_TICK
    return Servo(
        options.id,
        baud=baud,
        model=BY_NAME[options.model].number,
        position_ticks=float(round(start / reg.RAD_PER_TICK)),
        stops_ticks=stops,
    )


def tendons_of(servos: Sequence[Servo], axes: Sequence[AxisOnBus]) -> TendonPlant | None:
    """Tendons on the spools of axes whose homing tensions them, each on its own, taut in the servo's zero."""
    found = [
        (servo, axis.options.homing.direction)
        for servo, axis in zip(servos, axes, strict=True)
        if isinstance(axis.options, DynamixelAxisOptions) and isinstance(axis.options.homing, Tensioning)
    ]
    if not found:
        return None
    spools, winding = zip(*found, strict=True)
    return TendonPlant(spools, winding, (0.0,) * len(spools), (MA_PER_TICK,) * len(spools))


class Bench:
    """Context manager that serves the bus at the port of the robot file."""

    def __init__(
        self, name: str, options: DynamixelBusOptions, axes: Sequence[AxisOnBus], control: Path | None = None
    ) -> None:
        self._name = name
        self._control = control
        servos = [servo_of(axis, options.baud) for axis in axes]
        self.emulator = DynamixelEmulator(servos, options.port, control)
        self.tendons = tendons_of(servos, axes)

    def __enter__(self) -> Sequence[str]:
        """Start; returns a description of the bus."""
        self.emulator.start()
        ids = ", ".join(str(servo.device) for servo in self.emulator.servos)
        lines = [f"{self._name}: {self.emulator.port}, servos {ids}"]
        if self._control is not None:
            lines.append(f"{self._name}: fault switches from {self._control}, one JSON object per line")
        return lines

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self.emulator.stop()
