"""A Due board as a bus: one demand, one telemetry per tick."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Mapping, Sequence

from contid.errors import DeviceError, DeviceLostError
from contid.hal import AxisOnBus, Clock, Rest, Sample
from contid_drivers.due import identity, messages
from contid_drivers.due.axis import POSITION_LOST, BoardAxis
from contid_drivers.due.codes import BoardState, Reason, RestCode, Type
from contid_drivers.due.messages import Hello, PulseTrace, Refused, Telemetry
from contid_drivers.due.options import DueBusOptions
from contid_drivers.due.session import BoardRefusedError, DueConnection

log = logging.getLogger(__name__)

#: A board silent for longer than this [s] counts as lost.
SILENCE_S = 0.5
#: After a silence of this [s] another board may be at the port: it is found before an order can reach it.
EXCHANGED_S = 0.05
#: Attempts of a request before its axes count as silent.
_TRIES = 3
#: Firmware from which a stop lets go what a channel holds in its safe state.
_RELAXES_SAFE = (1, 7, 2)


class DueBus:
    """A Due board and its axes, on one port (`contid.hal.Bus`)."""

    def __init__(self, name: str, options: DueBusOptions, axes: Sequence[AxisOnBus], clock: Clock) -> None:
        self.name = name
        self.axes = tuple(axis.name for axis in axes)
        self._options = options
        self._axes_on_bus = tuple(axes)
        self._clock = clock
        self._by_name = {axis.name: BoardAxis(axis) for axis in axes}
        #: Rest of axes that the board has not confirmed, by name; requested again when it answers.
        self._pending_rest: dict[str, RestCode] = {}
        self._session: DueConnection | None = None
        #: Why the bus cannot be used, "" while it can.
        self._lost = "it is not open"
        self._boot_id: int | None = None
        #: Where the motors stood at the last close, while no sample has come.
        self._stood: Mapping[str, float | None] = {}
        self._answered_s = -math.inf
        self._exchanges = self._unanswered = 0
        self.telemetry: Telemetry | None = None

    def open(self) -> None:
        """See `contid.hal.Bus.open`; a board with the same configuration keeps its state."""
        self.close()
        session = DueConnection(self.name, self._options, self._axes_on_bus)
        self._session = session
        self._lost = ""
        if self._boot_id not in (None, session.hello.boot_id):
            # A restarted board assumes parked shafts, which is wrong for shafts that this host has moved.
            self._park(session, [axis for axis in self._by_name.values() if axis.motor], parked=False)
        elif session.memory is not None:
            away = identity.unparked(session.hello, self._by_name.values(), session.memory)
            self._park(session, away, parked=False)
        if session.memory is not None:
            self._stood = identity.stood_before(session.hello, session.memory)
            identity.keep(session.hello, session.memory, {})
        self._boot_id = session.hello.boot_id
        self._answered_s = self._clock.now()

    @property
    def hello(self) -> Hello:
        """The board's hello at `open`."""
        return self._need_session().hello

    def close(self) -> None:
        """See `contid.hal.Bus.close`; outputs stay under the board's watchdog."""
        if self._session is not None:
            self._session.close()
            # Where `open` failed, motors may not have lost the position that they have to lose.
            if self._session.memory is not None and self._boot_id == self._session.hello.boot_id:
                identity.keep(self._session.hello, self._session.memory, self._positions())
        self._session = None
        self._lost = "it is closed"
        for axis in self._by_name.values():
            axis.enabled = False

    def _positions(self) -> dict[str, float | None]:
        """Where the motors without homing stand [rad]; None where their position is lost."""
        axes = [axis for axis in self._by_name.values() if axis.motor and not axis.homes]
        return {
            axis.name: None
            if axis.position_lost
            else self._stood.get(axis.name)
            if axis.value is None
            else axis.value
            for axis in axes
        }

    def exchange(self, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        """See `contid.hal.Bus.exchange`: one demand out, one telemetry back."""
        values = self._checked(commands)
        session = self._need_session()
        now = self._clock.now()
        velocities = {
            axis.channel: velocity
            for name, value in commands.items()
            if (axis := self._axis(name)).channel in values
            and (velocity := axis.command_velocity(value, now)) is not None
        }
        body = messages.demand(session.config_crc, session.echo_ms, values, velocities)
        fresh = self._update(self._command(session, Type.DEMAND, body))
        if fresh and any(not self._keeps_rest(session, name) for name in self._pending_rest):
            self._stop(session)
        self._exchanges += 1
        self._unanswered += not fresh
        now = self._clock.now()
        if not fresh and now - self._answered_s > SILENCE_S:
            self._mark_lost(f"no answer for {now - self._answered_s:.1f} s")
        return {name: axis.sample(now, fresh) for name, axis in self._by_name.items()}

    def answer_counts(self) -> Mapping[str, int]:
        """Counts since the bus was built, by what is counted: ``exchanges``, ``late``, ``silent``."""
        counts = {"exchanges": self._exchanges, "silent": self._unanswered}
        if self.telemetry is not None:
            counts["watchdog_trips"] = self.telemetry.trips
            counts["missed_edges"] = sum(each.missed_edges for each in self.telemetry.channels.values())
        return counts

    def enable(self, axes: Sequence[str]) -> None:
        """See `contid.hal.Bus.enable`; starts the board's watchdog."""
        chosen = [self._axis(name) for name in axes]
        session = self._need_session()
        body = messages.demand(session.config_crc, session.echo_ms, {})
        if not self._update(self._command(session, Type.DEMAND, body)):
            raise BoardRefusedError(self.name, "cannot enable", axes, None)
        for axis in chosen:
            if axis.fault:
                remedy = "" if axis.fault == POSITION_LOST else "clear the fault first"
                raise DeviceError(f"{self.name}: {axis.name}", axis.fault, remedy)
            if axis.silent or axis.value is None:
                raise DeviceError(f"{self.name}: {axis.name}", "it does not answer")
        stray = [axis.name for axis in chosen if axis.armed and not axis.enabled]
        if stray:
            # Armed by an earlier host with that host's goal; arming from rest takes the present position.
            self.disable(stray, Rest.HOLD)
            if any(axis.armed for axis in chosen if axis.name in stray):
                raise BoardRefusedError(self.name, "cannot enable", stray, None)
        self._request_for(session, Type.ARM, "cannot enable", [axis for axis in chosen if not axis.armed])
        for axis in chosen:
            axis.enabled = True
            self._pending_rest.pop(axis.name, None)

    def disable(self, axes: Sequence[str], rest: Rest) -> None:
        """See `contid.hal.Bus.disable`: motors hold or coast, regulators hold, close or vent."""
        for name in axes:
            self._axis(name).enabled = False
        self._pending_rest.update(dict.fromkeys(axes, RestCode[rest.name]))
        session = self._session
        if session is None or self._lost:
            return
        try:
            for _ in range(_TRIES):
                if self._stop(session):
                    if held := [name for name in axes if name in self._pending_rest]:
                        names = ", ".join(held)
                        log.error("%s: %s: hold in their safe state until clear-fault", self.name, names)
                    return
        except DeviceLostError:
            return
        log.error("%s: stop not confirmed for %s; it is repeated", self.name, ", ".join(axes))

    def _stop(self, session: DueConnection) -> bool:
        """Request the pending rests; False when one is not confirmed.

        A board before firmware 1.7.2 ignores those of channels in their safe state. Where that state holds,
        another rest stays pending until the fault is cleared.
        """
        for rest in dict.fromkeys(self._pending_rest.values()):
            names = [name for name, pending in self._pending_rest.items() if pending is rest]
            body = messages.stop((self._axis(name).channel for name in names), rest)
            if not self._update(self._command(session, Type.STOP, body)):
                return False
            for name in names:
                if rest is RestCode.HOLD or not self._keeps_rest(session, name):
                    del self._pending_rest[name]
        return True

    def _keeps_rest(self, session: DueConnection, name: str) -> bool:
        return session.hello.firmware < _RELAXES_SAFE and self._axis(name).holds_safely

    def clear_fault(self, axes: Sequence[str]) -> None:
        """See `contid.hal.Bus.clear_fault`; a lost position stays lost."""
        chosen = [self._axis(name) for name in axes]
        self._request_for(self._need_session(), Type.CLEAR, "cannot clear", chosen)

    def park(self, axes: Sequence[str]) -> None:
        """Set the count of axes that stand at ``power_up_deg`` now."""
        self._park(self._need_session(), [self._axis(name) for name in axes], parked=True)

    def _park(self, session: DueConnection, axes: Sequence[BoardAxis], parked: bool) -> None:
        body = messages.park(session.config_crc, (axis.channel for axis in axes), parked)
        self._request(session, Type.PARK, "cannot park", axes, body)

    def home(self, axes: Sequence[str], moved: bool = False) -> None:
        """Start homing; call `exchange` until `homing` is false.

        Where an end stop may have ``moved``, it need not be where the board found it before.
        """
        if moved:
            self._park(self._need_session(), [self._axis(name) for name in axes], parked=False)
        self._request_for(self._need_session(), Type.HOME, "cannot home", [self._axis(name) for name in axes])

    def pulse(self, axis: str, duty: int, ms: int) -> None:
        """Order one open-loop pulse of an axis; it is not repeated, because it may have been obeyed.

        Raises:
            BoardRefusedError: the board refused it, or did not answer.
        """
        self.exchange({})  # the order echoes a telemetry of now
        session = self._need_session()
        body = messages.pulse(session.config_crc, session.echo_ms, self._axis(axis).channel, duty, ms)
        answer = self._command(session, Type.PULSE, body)
        if not self._update(answer):
            refused = answer if isinstance(answer, Refused) else None
            raise BoardRefusedError(self.name, "cannot pulse", [axis], refused)

    def pulse_trace(self) -> PulseTrace | None:
        """What the newest pulse caused so far; None when the board did not answer in time."""
        return self._need_session().trace()

    def reason(self, axis: str) -> Reason | None:
        """Why the axis was in its safe state in the newest telemetry."""
        report = self._axis(axis).report
        return None if report is None else report.reason

    def homing(self, axis: str) -> bool:
        """True while the newest telemetry has the axis searching its end stop."""
        report = self._axis(axis).report
        return report is not None and report.state is BoardState.HOMING

    def homed(self, axis: str) -> bool:
        """True when the axis had found its end stop in the newest telemetry."""
        report = self._axis(axis).report
        return report is not None and report.homed

    def _request_for(self, session: DueConnection, kind: Type, what: str, axes: Sequence[BoardAxis]) -> None:
        """Send a request whose body is the mask of the axes' channels."""
        body = messages.mask_body(session.config_crc, (axis.channel for axis in axes))
        self._request(session, kind, what, axes, body)

    def _request(
        self, session: DueConnection, kind: Type, what: str, axes: Sequence[BoardAxis], body: bytes
    ) -> None:
        if not axes:
            return
        # Arming, clearing, homing and parking are idempotent, so a request without an answer is repeated.
        refusal = None
        for _ in range(_TRIES):
            answer = self._command(session, kind, body)
            if self._update(answer):
                return
            if isinstance(answer, Refused):
                refusal = answer
                break
        raise BoardRefusedError(self.name, what, [axis.name for axis in axes], refusal)

    def _command(self, session: DueConnection, kind: Type, body: bytes) -> Telemetry | Refused | None:
        try:
            if kind is not Type.DEMAND and self._clock.now() - self._answered_s > EXCHANGED_S:
                # Without an answer the order is sent all the same: a stop must not depend on the way back.
                session.command(Type.DEMAND, messages.demand(session.config_crc, session.echo_ms, {}))
            return session.command(kind, body)
        except DeviceLostError as lost:
            self._lost = lost.message
            raise

    def _update(self, answer: Telemetry | Refused | None) -> bool:
        if not isinstance(answer, Telemetry):
            return False
        now = self._clock.now()
        self._answered_s = now
        self.telemetry = answer
        # The tick that measured it was up to a period before the request.
        age_s = max(time.monotonic() - self._need_session().clock.sampled_s, 0.0)
        for axis in self._by_name.values():
            report = answer.channels.get(axis.channel)
            axis.silent = report is None
            axis.supply_low = answer.supply_low
            if report is not None:
                axis.update(report, now - age_s)
        return True

    def _checked(self, commands: Mapping[str, float]) -> dict[int, int]:
        values = {}
        for name, value in commands.items():
            axis = self._axis(name)
            if not math.isfinite(value):
                raise DeviceError(f"{self.name}: {name}", f"command {value} is not finite")
            if axis.enabled and axis.armed and not axis.fault:
                values[axis.channel] = axis.to_board(value)
        return values

    def _axis(self, name: str) -> BoardAxis:
        try:
            return self._by_name[name]
        except KeyError:
            raise DeviceError(self.name, f"no axis {name!r}; axes: {', '.join(self.axes)}") from None

    def _need_session(self) -> DueConnection:
        if self._session is None or self._lost:
            raise DeviceLostError(self.name, self._lost, "open it again")
        return self._session

    def _mark_lost(self, why: str) -> None:
        if self._session is not None:
            self._session.close()
        self._lost = why
        raise DeviceLostError(self.name, why, "check power and that the contid sketch runs")
