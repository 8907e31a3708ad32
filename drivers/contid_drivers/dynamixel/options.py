"""Robot-file keys of a Dynamixel bus and of its servos."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self, TypeAlias

from pydantic import BeforeValidator, Field, model_validator

from contid.robot_file.base import NonNegative, Positive, Strict
from contid_drivers.dynamixel.models import BY_NAME, ModelName, refusal

#: Supported operating modes: both count several turns; the second also limits the current.
Mode: TypeAlias = Literal["extended_position", "current_based_position"]


class DynamixelBusOptions(Strict):
    """Keys of ``buses.NAME`` with ``driver: dynamixel``.

    Attributes:
        port: device path, preferably ``/dev/serial/by-id/...``, or a glob that matches exactly one device.
        baud: rate on the wire; every servo must have it (`contid servo set-baud`).
        return_delay_us: Return Delay Time (register 9) written to every servo; the factory's is 500.
        usb_latency_ms: allowance for the adapter, added to every time-out. The default requires the latency
            timer of an FTDI adapter at 1 ms (`contid doctor`).
        watchdog_ms: Bus Watchdog (register 98): a servo stops after this time without an instruction.
        mode: operating mode of axes without their own.
        fast_read: ``auto`` uses Fast Sync Read if every servo's firmware has it, ``off`` never does.
        telemetry_every: voltage, temperature and error status are read in every n-th exchange; position,
            velocity, current and watchdog in each one.
        slack_ms: an exchange without a single byte at its time-out waits on this long, because the host has
            stalled; ``auto`` measures (99.9th percentile of the lateness, at least a scheduler tick of 4 ms).
        retry_ms: time for repeating lost reads within one exchange; 0 switches retries off.
    """

    port: str = Field(min_length=1)
    baud: Literal[9600, 57600, 115200, 1000000, 2000000, 3000000, 4000000] = 1000000
    return_delay_us: int = Field(default=0, ge=0, le=508, multiple_of=2)
    usb_latency_ms: Annotated[float, Field(gt=0, le=200)] = 1.5
    watchdog_ms: int = Field(default=100, ge=20, le=2540, multiple_of=20)
    mode: Mode = "extended_position"
    fast_read: Literal["auto", "off"] = "auto"
    telemetry_every: int = Field(default=1, ge=1, le=1000)
    slack_ms: Literal["auto"] | Annotated[float, Field(ge=0, le=200)] = "auto"
    retry_ms: Annotated[float, Field(ge=0, le=100)] = 2.0


class HardStop(Strict):
    """Homing against a mechanical stop with low current.

    Attributes:
        method: ``hard_stop``.
        direction: sense of the servo's own rotation towards the stop.
        current_ma: current while pushing; the stop is where the servo stands still with it.
        speed_deg_s: speed of the approach.
        backoff_deg: distance moved back afterwards.
        at_mm: length (or travel) of the actuator at the stop.
        timeout_s: time limit of the search.
    """

    method: Literal["hard_stop"]
    direction: Literal[1, -1]
    current_ma: Annotated[int, Field(ge=20, le=600)] = 150
    speed_deg_s: Annotated[float, Field(gt=0, le=360)] = 45.0
    backoff_deg: NonNegative = 5.0
    at_mm: float = 0.0
    timeout_s: Positive = 30.0


class SingleTurn(Strict):
    """Homing by a stored pose: the robot is parked in it at power-up, so the nearest turn is the right one.

    Attributes:
        method: ``single_turn``.
        pose_deg: angle of the servo in that pose, on the scale of the axis's ``zero_deg``.
        plausible_deg: largest accepted distance from it at power-up.
        at_mm: length (or travel) of the actuator in that pose.
    """

    method: Literal["single_turn"]
    pose_deg: float
    plausible_deg: Annotated[float, Field(gt=0, lt=180)] = 30.0
    at_mm: float = 0.0


class Tensioning(Strict):
    """Homing of a tendon on a spool: all tendons that have it wind in until they carry a current.

    Attributes:
        method: ``tension``.
        direction: sense of the servo's own rotation that winds in.
        current_ma: current that the taut tendon carries; it sets the pretension.
        speed_deg_s: speed of winding.
        slack_deg: a tendon that is not taut after this rotation is slack or snapped.
        at_mm: pull of the tendon then, 0 on the straight robot.
        timeout_s: time limit of the search.
        slack_ma: while the robot runs, a tendon that carries less current than this and is not paid out is
            slack or snapped, which is a fault of its axis; left out, tendons are not watched.
        slack_ms: after this time.
    """

    #: `contid home` homes all such axes of a bus in one call.
    together: ClassVar[bool] = True

    method: Literal["tension"]
    direction: Literal[1, -1]
    current_ma: Annotated[int, Field(ge=45, le=600)] = 80
    speed_deg_s: Annotated[float, Field(gt=0, le=360)] = 45.0
    slack_deg: Annotated[float, Field(gt=0, le=3600)] = 720.0
    at_mm: float = 0.0
    timeout_s: Positive = 60.0
    slack_ma: Annotated[int, Field(ge=1, le=600)] | None = None
    slack_ms: Positive = 500.0

    @model_validator(mode="after")
    def _taut_is_not_slack(self) -> Self:
        if self.slack_ma is not None and self.slack_ma >= self.current_ma:
            raise ValueError(
                f"slack_ma {self.slack_ma} is not below the {self.current_ma} mA of a taut tendon"
            )
        return self


Homing: TypeAlias = Annotated[HardStop | SingleTurn | Tensioning, Field(discriminator="method")]


def _supported(name: object) -> object:
    """Refuse by name the models that contid cannot drive."""
    if isinstance(name, str) and (why := refusal(name)):
        raise ValueError(why)
    return name


class DynamixelAxisOptions(Strict):
    """Keys of an axis on a Dynamixel bus; settings left out keep the servo's values.

    Attributes:
        id: the servo's id.
        model: model the handshake must find.
        mode: operating mode; the bus's if left out.
        current_limit_ma: Current Limit (register 38).
        goal_current_ma: Goal Current (register 102) in current-based position mode.
        profile_velocity_deg_s: Profile Velocity (register 112); 0 is none, as streamed goals need.
        profile_acceleration_deg_s2: Profile Acceleration (register 108); likewise.
        position_p: Position P Gain (register 84).
        position_i: Position I Gain (register 82).
        position_d: Position D Gain (register 80).
        following_error_deg: a servo that stays further behind its goal, at standstill or with half of its
            current limit, is a fault; 30 if left out, none in current-based position mode.
        following_error_ms: after this time.
        homing: search of the turn after power-up; without it the servo's count is used unchecked.
    """

    id: int = Field(ge=0, le=252)
    model: Annotated[ModelName, BeforeValidator(_supported)] = "xl330-m288"
    mode: Mode | None = None
    current_limit_ma: int | None = Field(default=None, ge=1)
    goal_current_ma: int | None = Field(default=None, ge=1)
    profile_velocity_deg_s: NonNegative = 0.0
    profile_acceleration_deg_s2: NonNegative = 0.0
    position_p: int | None = Field(default=None, ge=0, le=16383)
    position_i: int | None = Field(default=None, ge=0, le=16383)
    position_d: int | None = Field(default=None, ge=0, le=16383)
    following_error_deg: Positive | None = None
    following_error_ms: Positive = 500.0
    homing: Homing | None = None

    @model_validator(mode="after")
    def _currents_of_the_model(self) -> Self:
        """Currents end at that of the model and at the axis's own limit; without registers there are none."""
        limit_ma = BY_NAME[self.model].current_limit_ma
        homing_ma = self.homing.current_ma if isinstance(self.homing, HardStop | Tensioning) else None
        currents = {
            "current_limit_ma": self.current_limit_ma,
            "goal_current_ma": self.goal_current_ma,
            "homing.current_ma": homing_ma,
        }
        for key, current_ma in currents.items():
            if current_ma is not None and not limit_ma:
                raise ValueError(f"{key} has no meaning: {self.model} has no current registers")
            if current_ma is not None and current_ma > limit_ma:
                raise ValueError(f"{key} {current_ma} is too much for {self.model}; allowed: {limit_ma:.0f}")
            if current_ma is not None and current_ma > (self.current_limit_ma or limit_ma):
                raise ValueError(f"{key} {current_ma} is above current_limit_ma {self.current_limit_ma}")
        if self.mode == "current_based_position" and not limit_ma:
            raise ValueError(f"mode current_based_position: {self.model} has no current registers")
        return self
