"""Driver for Feetech bus servos: keys of the robot file, and what builds buses. They have no watchdog."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, Field

from contid.hal import AxisOnBus, Bus, Clock, DeviceKind, Driver, Finding
from contid.robot_file.base import Strict
from contid_driverkit import EffortStop, HomesByEffort, MonotonicClock, examine_bus


class FeetechOptions(Strict):
    """Keys of ``buses.NAME`` with ``driver: feetech``.

    Attributes:
        port: path of the serial port, or a glob.
        baud: rate of the bus [bit/s].
        series: ``sts`` (also SMS; 4096 steps per turn) or ``scs`` (1024 steps in 300 degrees).
        latency_ms: allowance for the adapter, per request.
        echo: true for an adapter that returns what is sent.
    """

    port: str
    baud: Annotated[int, Field(ge=9600, le=1_000_000)] = 1_000_000
    series: Literal["sts", "scs"] = "sts"
    latency_ms: Annotated[float, Field(gt=0, le=100)] = 4.0
    echo: bool = False


class FeetechAxisOptions(Strict):
    """Keys of an axis on a bus of Feetech servos.

    Attributes:
        id: of the servo.
        speed_deg_s: greatest speed; 0 for that of the servo.
        acceleration: register 41 in units of 100 steps/s^2; 0 for the greatest. STS only.
        homing: search of an end stop, by the current of an STS servo (`contid_driverkit.EffortStop`).
    """

    id: Annotated[int, Field(ge=0, le=252)]
    speed_deg_s: Annotated[float, Field(ge=0, le=2000)] = 0.0
    acceleration: Annotated[int, Field(ge=0, le=254)] = 0
    homing: EffortStop | None = None


class FeetechDriver(HomesByEffort):
    """See `contid.hal.Driver`; it `Emulates`, `Diagnoses` and `Homes`, too."""

    bus_options: type[BaseModel] = FeetechOptions
    axis_options: type[BaseModel] = FeetechAxisOptions

    def kind(self, axis: BaseModel) -> DeviceKind:
        return DeviceKind.SERVO

    def address(self, axis: BaseModel) -> str:
        assert isinstance(axis, FeetechAxisOptions)
        return f"id {axis.id}"

    def mock_options(self, bus: BaseModel) -> Mapping[str, Any]:
        return {}

    def mock_axis_options(self, axis: BaseModel) -> Mapping[str, Any]:
        return {"device": DeviceKind.SERVO.value, "velocity_deg_s": 300.0}  # STS3215 at 7.4 V: 50 rpm

    def open_bus(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], clock: Clock) -> Bus:
        from contid_feetech.bus import FeetechBus

        assert isinstance(options, FeetechOptions)
        return FeetechBus(name, options, axes, clock)

    def emulator(
        self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], control: Path | None = None
    ) -> AbstractContextManager[Sequence[str]]:
        from contid_feetech.emulator import emulated

        assert isinstance(options, FeetechOptions)
        return emulated(options, axes, control)

    def doctor(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus]) -> list[Finding]:
        assert isinstance(options, FeetechOptions)
        return examine_bus(self.open_bus(name, options, axes, MonotonicClock()), options.port)


DRIVER: Final[Driver] = FeetechDriver()
