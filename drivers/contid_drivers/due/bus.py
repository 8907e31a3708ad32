"""A Due board as a bus: one demand, one telemetry per tick."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from contid.errors import DeviceError, DeviceLostError
from contid.hal import AxisOnBus, Clock, DeviceKind, Rest, Sample
from contid_drivers.due import messages
from contid_drivers.due.codes import DUTY_FULL, BoardState, RestCode, Type
from contid_drivers.due.messages import BoardReport, Hello, Refused, Telemetry
from contid_drivers.due.options import DueBusOptions
from contid_drivers.due.session import DueConnection, refused
from contid_drivers.due.wiring import Scale, axis_options

#: A board that says nothing for so long is gone, not late.
SILENCE_S = 0.5
#: Demands stay inside what the board computes with.
_MOST = 1_000_000_000
_REST = {Rest.HOLD: RestCode.HOLD, Rest.RELAX: RestCode.RELAX, Rest.VENT: RestCode.VENT}
_REFERENCE_LOST = "position lost in a reset: home it, or park it where it is powered up and clear the fault"


class _Axis:
    """What the bus keeps of one axis."""

    def __init__(self, axis: AxisOnBus) -> None:
        options = axis_options(axis)
        self.name = axis.name
        self.channel = options.number
        self.scale = Scale(options)
        self.motor = options.kind is DeviceKind.MOTOR
        self.homes = options.homing is not None
        self.has_current = options.stall_current_ma > 0
        self.value: float | None = None
        self.time_s = -math.inf
        self.report: BoardReport | None = None
        self.reference_lost = False
        self.enabled = False
        self.silent = True

    @property
    def fault(self) -> str:
        """The device's own fault in words."""
        if self.report is not None and self.report.state is BoardState.SAFE:
            return self.report.reason.message
        return _REFERENCE_LOST if self.reference_lost else ""

    @property
    def armed(self) -> bool:
        """Whether the newest telemetry says the channel follows demands."""
        return self.report is not None and self.report.state is BoardState.ARMED

    def take(self, report: BoardReport, now: float) -> None:
        """Keep what the board says of this axis; a reading without sensor is no reading."""
        self.report = report
        self.silent = False
        if report.sensor_ok:
            self.value = self.scale.from_board(report.position)
            self.time_s = now

    def sample(self, now: float, fresh: bool) -> Sample:
        """The sample of this exchange."""
        report = self.report
        if self.value is None or report is None:
            return Sample(value=None, time_s=now, valid=False, age_s=math.inf, fault=self.fault)
        effort = None
        if not self.motor:
            effort = report.duty / DUTY_FULL
        elif self.has_current:
            effort = report.aux / 1000.0
        return Sample(
            value=self.value,
            time_s=self.time_s,
            valid=fresh and report.sensor_ok and not self.silent,
            age_s=now - self.time_s,
            velocity=self.scale.from_board(report.velocity),
            effort=effort,
            fault=self.fault,
        )


class DueBus:
    """See `contid.hal.Bus`."""

    def __init__(self, name: str, options: DueBusOptions, axes: Sequence[AxisOnBus], clock: Clock) -> None:
        self.name = name
        self.axes = tuple(axis.name for axis in axes)
        self._options = options
        self._given = tuple(axes)
        self._clock = clock
        self._by_name = {axis.name: _Axis(axis) for axis in axes}
        self._session: DueConnection | None = None
        self._lost = "it was never opened"
        self._boot: int | None = None
        self._heard_s = -math.inf

    def open(self) -> None:
        """Wait for hello, check role, version and configuration; a board that kept all goes on as it is."""
        self.close()
        session = DueConnection(self.name, self._options, self._given)
        self._session = session
        self._lost = ""
        if self._boot is not None and session.hello.boot != self._boot:
            for axis in self._by_name.values():
                axis.reference_lost = axis.motor and not axis.homes
        self._boot = session.hello.boot
        self._heard_s = self._clock.now()

    @property
    def hello(self) -> Hello:
        """What the board said of itself when it was opened."""
        return self._need_session().hello

    def close(self) -> None:
        """Let the port go; outputs are left to the board."""
        if self._session is not None:
            self._session.close()
        self._session = None
        self._lost = "it is closed"
        for axis in self._by_name.values():
            axis.enabled = False

    def exchange(self, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        """One demand with the values of this tick, one telemetry."""
        values = self._checked(commands)
        session = self._need_session()
        body = messages.demand(session.config_crc, session.heard_ms, values)
        fresh = self._take(self._command(session, Type.DEMAND, body))
        now = self._clock.now()
        if not fresh and now - self._heard_s > SILENCE_S:
            self._lose(f"no answer for {now - self._heard_s:.1f} s")
        return {name: axis.sample(now, fresh) for name, axis in self._by_name.items()}

    def enable(self, axes: Sequence[str]) -> None:
        """Arm channels where they stand; the board's dead-man starts."""
        wanted = [self._axis(name) for name in axes]
        session = self._need_session()
        if not self._take(
            self._command(session, Type.DEMAND, messages.demand(session.config_crc, session.heard_ms, {}))
        ):
            raise refused(self.name, "cannot enable", axes, None)
        for axis in wanted:
            if axis.fault:
                raise DeviceError(f"{self.name}: {axis.name}", axis.fault, "clear the fault first")
            if axis.silent or axis.value is None:
                raise DeviceError(f"{self.name}: {axis.name}", "it is silent")
        stray = [axis.name for axis in wanted if axis.armed and not axis.enabled]
        if stray:
            # Armed by a host that is gone, with that host's goal: from rest it is armed where it stands.
            self.disable(stray, Rest.HOLD)
        self._grant(session, Type.ARM, "cannot enable", [axis for axis in wanted if not axis.armed])
        for axis in wanted:
            axis.enabled = True

    def disable(self, axes: Sequence[str], rest: Rest) -> None:
        """Stop channels: motors hold or coast, regulators hold, close or vent. Best effort."""
        for name in axes:
            self._axis(name).enabled = False
        session = self._session
        if session is None or self._lost:
            return
        body = messages.stop((self._axis(name).channel for name in axes), _REST[rest])
        for _ in range(3):
            try:
                if self._take(self._command(session, Type.STOP, body)):
                    return
            except DeviceLostError:
                return

    def clear_fault(self, axes: Sequence[str]) -> None:
        """Acknowledge latched faults, and that a robot without homing is parked again after a reset."""
        session = self._need_session()
        wanted = [self._axis(name) for name in axes]
        self._grant(session, Type.CLEAR, "cannot clear", wanted)
        for axis in wanted:
            axis.reference_lost = False

    def home(self, axes: Sequence[str]) -> None:
        """Start homing; `exchange` keeps it alive and shows `homing` until it ends."""
        self._grant(self._need_session(), Type.HOME, "cannot home", [self._axis(name) for name in axes])

    def homing(self, axis: str) -> bool:
        """Whether the newest telemetry says the axis is still looking for its end stop."""
        report = self._axis(axis).report
        return report is not None and report.state is BoardState.HOMING

    def _grant(self, session: DueConnection, kind: Type, what: str, axes: Sequence[_Axis]) -> None:
        if not axes:
            return
        body = messages.masked(session.config_crc, (axis.channel for axis in axes))
        # Asked again when an answer is lost: arming, clearing and homing twice is the same as once.
        for _ in range(3):
            answer = self._command(session, kind, body)
            if self._take(answer):
                return
            if isinstance(answer, Refused):
                break
        raise refused(
            self.name, what, [axis.name for axis in axes], answer if isinstance(answer, Refused) else None
        )

    def _command(self, session: DueConnection, kind: Type, body: bytes) -> Telemetry | Refused | None:
        try:
            return session.command(kind, body)
        except DeviceLostError as lost:
            self._lost = lost.message
            raise

    def _take(self, answer: Telemetry | Refused | None) -> bool:
        if not isinstance(answer, Telemetry):
            return False
        now = self._clock.now()
        self._heard_s = now
        for axis in self._by_name.values():
            report = answer.channels.get(axis.channel)
            axis.silent = report is None
            if report is not None:
                axis.take(report, now)
        return True

    def _checked(self, commands: Mapping[str, float]) -> dict[int, int]:
        values = {}
        for name, value in commands.items():
            axis = self._axis(name)
            if not math.isfinite(value):
                raise DeviceError(f"{self.name}: {name}", f"command {value} is not finite")
            if axis.enabled and axis.armed and not axis.fault:
                values[axis.channel] = max(-_MOST, min(_MOST, axis.scale.to_board(value)))
        return values

    def _axis(self, name: str) -> _Axis:
        try:
            return self._by_name[name]
        except KeyError:
            raise DeviceError(self.name, f"no axis {name!r}; there are {', '.join(self.axes)}") from None

    def _need_session(self) -> DueConnection:
        if self._session is None or self._lost:
            raise DeviceLostError(self.name, self._lost or "it is not open", "open it again")
        return self._session

    def _lose(self, why: str) -> None:
        if self._session is not None:
            self._session.close()
        self._lost = why
        raise DeviceLostError(self.name, why, "is it powered? is its sketch running?")
