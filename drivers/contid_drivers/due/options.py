"""Robot-file keys of a Due board and of its axes: a motor or a regulator, by the channel."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from contid.hal import DeviceKind
from contid.robot_file.base import Strict
from contid_drivers.due.codes import NamedCode
from contid_drivers.due.motor_options import Bridge, MotorOptions
from contid_drivers.due.regulator_options import RegulatorOptions


class SafeState(NamedCode):
    """State of an output without a host.

    Motors: brake (terminals shorted), coast (bridge off), hold (position kept, under power). Regulators: vent
    (set-point falls to zero at ``vent_bar_s``), close (command to zero at once).
    """

    BRAKE = "brake"
    COAST = "coast"
    HOLD = "hold"
    VENT = "vent"
    CLOSE = "close"


class Role(NamedCode):
    """Kind of actuator a board drives."""

    MOTOR = "motor"
    PRESSURE = "pressure"


class DueBusOptions(Strict):
    """Keys of ``buses.NAME`` with ``driver: due``.

    Attributes:
        port: device path, preferably ``/dev/serial/by-id/...``, or a glob that matches exactly one device.
        connection: ``native`` is the USB port of the SAM3X itself (fast, opening does not reset the board);
            ``programming`` goes through the board's second chip at 250000 baud, and opening it resets the
            board.
        role: ``motor`` or ``pressure``; the board's hello must match.
        board_id: unique id of the board's chip (`contid scan` prints it); another board is refused.
        watchdog_ms: watchdog of the board: without a valid demand for this time every armed channel goes to
            its safe state, latched.
        latency_ms: allowance for the adapter and the host, added to every time-out.
        hello_ms: time-out of `open` for the board's hello, a reset and its start-up included.
    """

    port: str = Field(min_length=1)
    connection: Literal["native", "programming"] = "native"
    role: Role
    board_id: Annotated[str, Field(pattern="^[0-9a-f]{32}$")] | None = None
    watchdog_ms: int = Field(default=100, ge=5, le=10_000)
    latency_ms: Annotated[float, Field(gt=0, le=200)] = 4.0
    hello_ms: Annotated[float, Field(ge=100, le=20_000)] = 3000.0


class DueAxisOptions(MotorOptions, RegulatorOptions):
    """Keys of an axis on a Due board, next to the common ones; the channel's letter selects which apply.

    Attributes:
        channel: ``m0`` .. ``m5`` on a motor board, ``p0`` .. ``p5`` on a pressure board.
        on_watchdog: safe state, taken when the watchdog trips: ``brake`` (default), ``coast`` or ``hold`` for
            motors; with ``tension``, ``hold`` by default, which goes on above its floor; ``vent`` (default)
            or ``close`` for regulators.
        start_state: what the wiring makes the motor do while the board does not drive its lines (in reset, in
            the boot loader, before the first host): ``brake`` (default; inputs pulled up, or the PWM line of
            ``dir_pwm`` pulled down) or ``coast`` (inputs pulled down). ``on_watchdog`` must be the same; for
            ``on_watchdog: hold`` write down which it is, because no wiring holds. Regulators: ``close``, by
            the pull-down at the command; ``hold`` for valves whose outlet is shut without power.
    """

    channel: Literal["m0", "m1", "m2", "m3", "m4", "m5", "p0", "p1", "p2", "p3", "p4", "p5"]
    on_watchdog: SafeState | None = None
    start_state: SafeState | None = None

    @property
    def kind(self) -> DeviceKind:
        """Motor or regulator."""
        return DeviceKind.MOTOR if self.channel[0] == "m" else DeviceKind.REGULATOR

    @property
    def parkable(self) -> bool:
        """True for a motor without homing: it counts from its parked pose after a restart of the board."""
        return self.kind is DeviceKind.MOTOR and self.homing is None

    @property
    def number(self) -> int:
        """The channel's number on its board, 0..5."""
        return int(self.channel[1])

    @property
    def safe(self) -> SafeState:
        """The safe state; the default of this kind if not given."""
        default = SafeState.BRAKE if self.kind is DeviceKind.MOTOR else SafeState.VENT
        if self.tension is not None:
            default = SafeState.HOLD
        return self.on_watchdog or default

    @property
    def start(self) -> SafeState:
        """The start state; that of the wiring in docs/devices/due.md if not given."""
        default = SafeState.BRAKE if self.kind is DeviceKind.MOTOR else SafeState.CLOSE
        return self.start_state or default

    @model_validator(mode="after")
    def _fits_its_channel(self) -> DueAxisOptions:
        motor = self.kind is DeviceKind.MOTOR
        other = RegulatorOptions if motor else MotorOptions
        foreign = sorted(self.model_fields_set & other.model_fields.keys())
        if foreign:
            what = "motor" if motor else "regulator"
            raise ValueError(f"channel {self.channel} is a {what}; it has no {', '.join(foreign)}")
        allowed = (
            (SafeState.BRAKE, SafeState.COAST, SafeState.HOLD) if motor else (SafeState.VENT, SafeState.CLOSE)
        )
        if self.safe not in allowed:
            raise ValueError(f"on_watchdog of channel {self.channel} must be one of {', '.join(allowed)}")
        if motor:
            self.check_motor()
            self._check_start()
        else:
            self._check_regulator()
        return self

    def _check_start(self) -> None:
        no_coast = self.bridge is Bridge.DIR_PWM
        possible = (SafeState.BRAKE,) if no_coast else (SafeState.BRAKE, SafeState.COAST)
        if self.start not in possible:
            raise ValueError(
                f"start_state {self.start} of channel {self.channel} is not possible "
                f"with bridge {self.bridge}; possible: {', '.join(possible)}"
            )
        if self.safe is SafeState.HOLD:
            if self.start_state is None:
                raise ValueError(
                    "on_watchdog hold needs start_state: a reset ends the holding, and the motor does what "
                    f"its wiring gives ({' or '.join(possible)})"
                )
        elif self.safe is not self.start:
            raise ValueError(
                f"start_state {self.start} differs from on_watchdog {self.safe}: a reset leaves the safe "
                "state, so the board refuses this configuration"
            )

    def _check_regulator(self) -> None:
        keeps = self.valves is not None and self.valves.outlet == "normally_closed"
        if self.start is not (SafeState.HOLD if keeps else SafeState.CLOSE):
            why = (
                "an outlet that is shut without power keeps the pressure in a reset: write hold, "
                "or fit a valve that is open without power"
                if keeps
                else "in a reset the pull-down sets the command to zero at once (close)"
            )
            raise ValueError(f"start_state {self.start} of channel {self.channel} is not possible: {why}")
        needed = ("readback", "ceiling_bar") if self.valves else ("calibration", "readback", "ceiling_bar")
        missing = [key for key in needed if getattr(self, key) is None]
        if missing:
            raise ValueError(f"channel {self.channel} is a regulator and needs {', '.join(missing)}")
        if self.valves is None:
            self.check_calibration()
        elif self.calibration is not None or self.trim_bar:
            raise ValueError(f"channel {self.channel} has valves; it has no calibration and no trim_bar")
        self.check_readback()
