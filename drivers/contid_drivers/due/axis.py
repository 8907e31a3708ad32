"""One axis of a Due board on the host: its newest report, samples and faults."""

from __future__ import annotations

import math

from contid.hal import AxisOnBus, DeviceKind, Sample
from contid_drivers.due.codes import DUTY_FULL, BoardState
from contid_drivers.due.messages import BoardReport
from contid_drivers.due.options import SafeState
from contid_drivers.due.wiring import axis_options, board_units

#: Magnitude limit of a demand [counts or Pa]; the board computes in 32 bits.
DEMAND_LIMIT = 1_000_000_000
#: Commands further apart than this [s] are steps; the board does not interpolate between them.
STREAM_GAP_S = 0.1
_SUPPLY_LOW = "the 3.3 V supply of the board is below 3.0 V: its readings and outputs are wrong"
POSITION_LOST = "position lost: the board restarted; park the axis at power_up_deg, then contid home --parked"


class BoardAxis:
    """State of one axis on the host.

    The board measures motors in counts of the encoder, regulators in Pa.

    Attributes:
        name: ``ROBOT.AXIS``.
        channel: number of its channel on the board.
        units_per_si: units of the board per unit of the HAL: counts/rad of a motor, 1 Pa/Pa of a regulator.
        motor: True for a motor, False for a pressure regulator.
        power_up_rad: where a motor without homing is parked.
        homes: True when the robot file has ``homing`` for it.
        safe: its safe state.
        has_current: True when the board measures the current of the motor.
        value, time_s: last valid position [rad] or pressure [Pa], and its time [monotonic s].
        report: its report in the newest telemetry that had the channel; None before the first.
        enabled: True while commands are sent to it.
        silent: True while the newest telemetry lacks the channel.
        supply_low: True while the 3.3 V supply of the board is too low.
    """

    def __init__(self, axis: AxisOnBus) -> None:
        options = axis_options(axis)
        self.name = axis.name
        self.channel = options.number
        self.units_per_si = board_units(options)
        self.motor = options.kind is DeviceKind.MOTOR
        self.power_up_rad = math.radians(options.power_up_deg)
        self.homes = options.homing is not None
        self.safe = options.safe
        self.has_current = options.stall_current_ma > 0
        self.value: float | None = None
        self.time_s = -math.inf
        self.report: BoardReport | None = None
        self.enabled = False
        self.silent = True
        self.supply_low = False
        #: Newest command [rad or Pa] and its time [s].
        self._commanded = (0.0, -math.inf)

    @property
    def position_lost(self) -> bool:
        """True when it counts from an unknown position; it may have another fault beside that."""
        return self.report is not None and self.report.position_lost and not self.homes

    @property
    def fault(self) -> str:
        """Fault of the device, empty for none."""
        if self.report is not None and self.report.state is BoardState.SAFE:
            return self.report.reason.message
        if self.position_lost:
            return POSITION_LOST
        return _SUPPLY_LOW if self.supply_low else ""

    @property
    def armed(self) -> bool:
        """True when the channel followed demands in the newest telemetry."""
        return self.report is not None and self.report.state is BoardState.ARMED

    @property
    def holds_safely(self) -> bool:
        """True while it holds in its safe state, in which boards before firmware 1.7.2 keep that rest."""
        return (
            self.report is not None and self.report.state is BoardState.SAFE and self.safe is SafeState.HOLD
        )

    def command_velocity(self, value: float, now: float) -> int | None:
        """Velocity of a stream of commands, by this one and the one before, in the board's units per second.

        None when the two are too far apart in time: then the command is a step.
        """
        (last_value, last_s), self._commanded = self._commanded, (value, now)
        if not 0.0 < now - last_s <= STREAM_GAP_S:
            return None
        return self.to_board((value - last_value) / (now - last_s))

    def to_board(self, value: float) -> int:
        """A value [rad or Pa, or per s] in the board's units, rounded and limited."""
        return max(-DEMAND_LIMIT, min(DEMAND_LIMIT, round(value * self.units_per_si)))

    def update(self, report: BoardReport, now: float) -> None:
        """Store the channel's report; the value changes only with a valid sensor."""
        self.report = report
        self.silent = False
        if report.sensor_ok:
            self.value = report.position / self.units_per_si
            self.time_s = now

    def sample(self, now: float, fresh: bool) -> Sample:
        """Sample of this exchange.

        Args:
            now: time of the exchange [monotonic s].
            fresh: True when telemetry arrived in it.
        """
        report = self.report
        if self.value is None or report is None:
            return Sample(value=None, time_s=now, valid=False, age_s=math.inf, fault=self.fault)
        effort = None
        if not self.motor:
            effort = report.duty / DUTY_FULL
        elif self.has_current:
            effort = report.aux / 1000.0  # mA to A
        return Sample(
            value=self.value,
            time_s=self.time_s,
            valid=fresh and report.sensor_ok and not self.silent,
            age_s=now - self.time_s,
            velocity=report.velocity / self.units_per_si,
            effort=effort,
            tension_n=None if report.tension_mn is None else report.tension_mn / 1000.0,
            fault=self.fault,
        )
