"""What a robot file says about a Dynamixel bus and about each servo on it."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from contid.robot_file.base import NonNegative, Positive, Strict

#: Operating modes contid drives: both count several turns; the second also limits the current.
Mode: TypeAlias = Literal["extended_position", "current_based_position"]


class DynamixelBusOptions(Strict):
    """Keys of ``buses.NAME`` with ``driver: dynamixel``.

    Attributes:
        port: device path, best ``/dev/serial/by-id/...``, or a glob that matches exactly one device.
        baud: rate on the wire; every servo must have it (`contid servo set-baud`).
        return_delay_us: Return Delay Time (register 9) written to every servo; the factory's is 500.
        usb_latency_ms: how much later than on the wire a reply may arrive; added to every time-out. An FTDI
            adapter needs its latency timer at 1 ms for the default to be right (`contid doctor`).
        watchdog_ms: Bus Watchdog (register 98): a servo that hears nothing for so long stops.
        mode: operating mode of every axis that names none.
        fast_read: ``auto`` uses Fast Sync Read where every servo's firmware has it, ``off`` never does.
        telemetry_every: voltage, temperature and error status are read every so many exchanges; position,
            velocity, current and watchdog are read in each one.
        retry_ms: time inside one exchange for asking again for replies that went missing; 0 never asks.
    """

    port: str = Field(min_length=1)
    baud: Literal[9600, 57600, 115200, 1000000, 2000000, 3000000, 4000000] = 1000000
    return_delay_us: int = Field(default=0, ge=0, le=508, multiple_of=2)
    usb_latency_ms: Annotated[float, Field(gt=0, le=200)] = 1.5
    watchdog_ms: int = Field(default=100, ge=20, le=2540, multiple_of=20)
    mode: Mode = "extended_position"
    fast_read: Literal["auto", "off"] = "auto"
    telemetry_every: int = Field(default=1, ge=1, le=1000)
    retry_ms: Annotated[float, Field(ge=0, le=100)] = 2.0


class HardStop(Strict):
    """Homing against a mechanical stop with little current.

    Attributes:
        method: ``hard_stop``.
        direction: sense of the servo's own rotation towards the stop.
        current_ma: current while pushing; the stop is where the servo stands still with it.
        speed_deg_s: speed of the approach.
        backoff_deg: how far it moves back afterwards.
        at_mm: the actuator's length (or travel) when it touches the stop.
        timeout_s: longest search.
    """

    method: Literal["hard_stop"]
    direction: Literal[1, -1]
    current_ma: Annotated[int, Field(ge=20, le=600)] = 150
    speed_deg_s: Annotated[float, Field(gt=0, le=360)] = 45.0
    backoff_deg: NonNegative = 5.0
    at_mm: float = 0.0
    timeout_s: Positive = 30.0


class SingleTurn(Strict):
    """The robot is parked in one pose at power-up; the single-turn encoder tells the turn it must be in.

    Attributes:
        method: ``single_turn``.
        pose_deg: the servo's angle in that pose, on the scale the axis's ``zero_deg`` uses.
        plausible_deg: how far from it the servo may stand and still be believed.
        at_mm: the actuator's length (or travel) in that pose.
    """

    method: Literal["single_turn"]
    pose_deg: float
    plausible_deg: Annotated[float, Field(gt=0, lt=180)] = 30.0
    at_mm: float = 0.0


Homing: TypeAlias = Annotated[HardStop | SingleTurn, Field(discriminator="method")]


class DynamixelAxisOptions(Strict):
    """Keys of an axis on a Dynamixel bus; settings left out stay as the servo has them.

    Attributes:
        id: the servo's id.
        model: what the handshake must find.
        mode: operating mode, or the bus's.
        current_limit_ma: Current Limit (register 38).
        goal_current_ma: Goal Current (register 102) in current-based position mode.
        profile_velocity_deg_s: Profile Velocity (register 112); 0 is none, which is right for streamed goals.
        profile_acceleration_deg_s2: Profile Acceleration (register 108); likewise.
        position_p: Position P Gain (register 84).
        position_i: Position I Gain (register 82).
        position_d: Position D Gain (register 80).
        homing: how the servo finds its turn after power-up. Without it the count is trusted as it is.
    """

    id: int = Field(ge=0, le=252)
    model: Literal["xl330-m288", "xl330-m077"] = "xl330-m288"
    mode: Mode | None = None
    current_limit_ma: int | None = Field(default=None, ge=1, le=1750)
    goal_current_ma: int | None = Field(default=None, ge=1, le=1750)
    profile_velocity_deg_s: NonNegative = 0.0
    profile_acceleration_deg_s2: NonNegative = 0.0
    position_p: int | None = Field(default=None, ge=0, le=16383)
    position_i: int | None = Field(default=None, ge=0, le=16383)
    position_d: int | None = Field(default=None, ge=0, le=16383)
    homing: Homing | None = None
