"""The state of one servo on its host: what it is, whether it is driven, and whether its turn is known.

Angles are radians on the scale of the servo, ticks are the servo's count without `Axis.turns`. What a reading
of the servo changes is in `contid_drivers.dynamixel.readings`.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field
from typing import Final

from contid.errors import DeviceError
from contid.hal import AxisOnBus, Reference, Sample
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.models import BY_NAME, ServoModel
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions, Tensioning
from contid_drivers.dynamixel.plausibility import FollowingError, SlackTendon

RESET_FAULT: Final = "it reset itself (brown-out?); its watchdog, settings and turn count are gone"
#: Following error allowed in extended position mode.
FOLLOWING_ERROR_DEG: Final = 30.0


class Turn(enum.Enum):
    """How well `Axis.turns` is known.

    `turns.settle` leads to ``IN_SERVO`` or ``ON_HOST``, by the operating mode; where it refuses, to
    ``UNKNOWN``, or a ``LOST`` turn stays lost. `Axis.latch_reset` leads from each to ``LOST``.
    """

    UNKNOWN = enum.auto()  # readings are used, but show no jump and no reset
    ON_HOST = enum.auto()  # known; the servo keeps no record of it, so a reset cannot be proven
    IN_SERVO = enum.auto()  # known; the servo keeps a record that it loses when it resets
    LOST = enum.auto()  # the servo reset, or its position jumped: no reading counts until it is recovered


#: `Axis.turns` brings a position of the servo to the angle of its axis.
KNOWN_TURNS: Final = (Turn.ON_HOST, Turn.IN_SERVO)


class TorqueState(enum.Enum):
    """What the servo is to do; `IDLE`: it rests as it was asked to, with torque or without.

    ===============================  ==========================================================
    event                            next state
    ===============================  ==========================================================
    watchdog and torque are on       ``ENABLED``
    a fault is latched               ``HOLD_PENDING``; ``RELAX_PENDING`` stays
    a watchdog trips                 ``IDLE``: the servo has stopped; ``RELAX_PENDING`` stays
    the port fails, or opens again   ``IDLE``: it stops by its watchdog; what is pending stays
    rest asked for, not confirmed    ``HOLD_PENDING`` or ``RELAX_PENDING``
    rest confirmed                   ``IDLE``; arming and clearing a fault confirm it first
    ===============================  ==========================================================
    """

    IDLE = enum.auto()
    ENABLED = enum.auto()  # commands are sent to it
    HOLD_PENDING = enum.auto()  # it is to hold as soon as it answers
    RELAX_PENDING = enum.auto()  # its torque goes off as soon as it answers


#: The servo has to be brought to rest when it answers.
REST_PENDING: Final = (TorqueState.HOLD_PENDING, TorqueState.RELAX_PENDING)


@dataclass(slots=True)
class Axis:
    """One servo; angles in rad, times in s of the host's clock."""

    # From the robot file:
    name: str  # ROBOT.AXIS
    options: DynamixelAxisOptions
    travel: tuple[float, float] | None  # device range [rad]
    operating_mode: int  # value of register 11
    device: int  # id on the bus
    model: ServoModel
    reference: Reference = field(default_factory=Reference)  # what its homing must agree with
    following: FollowingError = field(default_factory=lambda: FollowingError(math.inf, 0.0))
    tendon: SlackTendon = field(default_factory=lambda: SlackTendon(0, 0.0, 0.0))
    # Read from the servo when its bus is opened, and before it is armed:
    firmware: int = 0
    return_delay_s: float = 0.0
    mark: str = ""  # which servo it is, see `checks.identity`; "" where that is not known
    own_pwm: int | None = None  # PWM Limit (36)
    greatest_ma: float = 0.0  # current that it exceeds in no mode: of file, servo or model; 0 for none
    # State; an axis with a fault is not enabled:
    state: TorqueState = TorqueState.IDLE
    turn: Turn = Turn.UNKNOWN
    fault: str = ""  # the first since it was cleared
    turns: int = 0  # added to the count of the servo
    seen: float | None = None  # last position while the turn was known
    goal: float | None = None  # newest command since it was armed
    watchdog_units: int = 0  # last written to its Bus Watchdog, time-out in units of 20 ms; 0 is off
    effort_share: float = 1.0  # of its current limit, see `grip`
    misses: int = 0  # consecutive exchanges without an answer
    # Newest measurement:
    value: float | None = None
    time_s: float = 0.0
    tick: int | None = None  # Realtime Tick of that reading, None where it was not read
    velocity: float | None = None  # rad/s
    effort: float | None = None  # A
    voltage_v: float | None = None
    temperature_c: float | None = None
    hardware_error: int = 0  # Hardware Error Status (70)

    def __post_init__(self) -> None:
        self.greatest_ma = self.options.current_limit_ma or self.model.current_limit_ma

    @classmethod
    def of(cls, axis: AxisOnBus, bus: DynamixelBusOptions) -> Axis:
        """Build the servo of an axis of the robot file."""
        options = axis.options
        assert isinstance(options, DynamixelAxisOptions)
        mode, model = options.mode or bus.mode, BY_NAME[options.model]
        current_based = mode == "current_based_position"
        if current_based and model.ma_per_unit is None:
            what = f"mode {mode} needs current registers, which {options.model} has not"
            raise DeviceError(axis.name, what, "write mode: extended_position at the axis")
        limit_deg = options.following_error_deg
        if limit_deg is None:
            # In the current-based mode pushing against something is the purpose.
            limit_deg = math.inf if current_based else FOLLOWING_ERROR_DEG
        servo = cls(
            axis.name, options, axis.travel, reg.MODE_NUMBERS[mode], options.id, model, axis.reference
        )
        servo.following = FollowingError(math.radians(limit_deg), options.following_error_ms / 1e3)
        homing = options.homing
        if isinstance(homing, Tensioning) and homing.slack_ma is not None:
            servo.tendon = SlackTendon(homing.direction, homing.slack_ma / 1e3, homing.slack_ms / 1e3)
        return servo

    def to_rad(self, ticks: int) -> float:
        """Angle [rad] of a position the servo reports."""
        return (ticks + self.turns * reg.TICKS_PER_REV) * reg.RAD_PER_TICK

    def to_ticks(self, angle: float) -> int:
        """Nearest position count of an angle [rad]."""
        return round(angle / reg.RAD_PER_TICK) - self.turns * reg.TICKS_PER_REV

    @property
    def dead(self) -> bool:
        """It was silent in the two last exchanges: not one lost packet, but a servo without power."""
        return self.misses > 1

    @property
    def enabled(self) -> bool:
        """Commands are sent to it."""
        return self.state is TorqueState.ENABLED

    def arm(self, watchdog: int) -> None:
        """Torque and watchdog are on, the goal is the present position."""
        self.watchdog_units, self.state, self.goal = watchdog, TorqueState.ENABLED, None
        self.following.clear()
        self.tendon.clear()

    def stop_commands(self) -> None:
        """Send no more commands; a rest that is pending stays pending."""
        if self.enabled:
            self.state = TorqueState.IDLE

    def latch(self, fault: str) -> bool:
        """Latch a fault, stop commanding the servo and hold it; False when one is latched already."""
        if self.fault:
            return False
        self.fault = fault
        self._require_hold()
        return True

    def latch_reset(self, fault: str = RESET_FAULT) -> None:
        """The servo lost its turn count: it reset itself, or its position jumped."""
        if self.turn is not Turn.LOST:
            self.turn = Turn.LOST
            self._require_hold()
        self.latch(fault)

    def _require_hold(self) -> None:
        if self.state is not TorqueState.RELAX_PENDING:
            self.state = TorqueState.HOLD_PENDING

    def sample(self, now: float, answered: bool) -> Sample:
        """Its sample at the end of an exchange; valid if that brought an answer which counts."""
        return Sample(
            self.value,
            self.time_s,
            answered and self.turn is not Turn.LOST,
            now - self.time_s if self.value is not None else 0.0,
            self.velocity,
            self.effort,
            self.temperature_c,
            self.voltage_v,
            self.fault,
        )
