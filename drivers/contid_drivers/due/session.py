"""Connection to one board: hello, configuration, requests with time-outs, detection of a reset."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Final

from contid.errors import DeviceError, DeviceLostError, DeviceNotFoundError
from contid.hal import AxisOnBus, DeviceKind
from contid.kit.remembered import memory_of
from contid.kit.serial_ports import find_port
from contid_drivers.due import identity, messages
from contid_drivers.due.codes import (
    CELL_ANALOG,
    CELL_CONVERTER,
    CURRENT_SENSE,
    PORTS,
    PROTOCOL_VERSION,
    VALVE_PAIR,
    Refusal,
    Type,
)  # fmt: skip
from contid_drivers.due.frames import DuePort, crc16
from contid_drivers.due.messages import Answer, Configured, Hello, PulseTrace, Refused, Telemetry
from contid_drivers.due.motor_options import Bridge
from contid_drivers.due.options import DueBusOptions
from contid_drivers.due.wiring import Adc, axis_options, board_config, config_body, refused_value

#: Bound of the drift of two crystals against each other, with their temperature (30 to 50 ppm each).
DRIFT: Final = 100e-6
#: Least time between two samples: a better estimate of the offset might place a tick before the last one.
STEP_S: Final = 1e-6
_WRAP_MS: Final = 1 << 32


class BoardClock:
    """Maps board times to host times; starts anew when its bounds contradict each other.

    Attributes:
        sampled_s: host time of the tick of the newest answer; later with every answer, also of the same tick.
    """

    def __init__(self) -> None:
        self._uptime_ms = self._total_ms = 0
        self._low_s, self._high_s = -math.inf, math.inf
        self._at_s = 0.0
        self.sampled_s = -math.inf

    def update(self, uptime_ms: int, age_us: int, asked_s: float, received_s: float) -> None:
        """Use an answer.

        Args:
            uptime_ms: tick of the board whose inputs it holds; wraps after 49 days.
            age_us: time from that tick to the answer.
            asked_s: host time before the request was sent.
            received_s: host time after the answer was received.
        """
        self._total_ms += (uptime_ms - self._uptime_ms) % _WRAP_MS
        self._uptime_ms = uptime_ms
        composed_s = self._total_ms / 1e3 + age_us / 1e6
        drift_s, self._at_s = DRIFT * abs(received_s - self._at_s), received_s
        low_s, high_s = asked_s - composed_s, received_s - composed_s
        self._low_s, self._high_s = max(low_s, self._low_s - drift_s), min(high_s, self._high_s + drift_s)
        if self._low_s > self._high_s:
            self._low_s, self._high_s = low_s, high_s
        sampled_s = self._total_ms / 1e3 + (self._low_s + self._high_s) / 2.0
        self.sampled_s = max(sampled_s, self.sampled_s + STEP_S)


#: Interval of repeated hellos while a board starts.
_HELLO_EVERY_S = 0.05
#: Bytes of the longest telemetry frame, for its time on the wire.
_TELEMETRY_BYTES = 157
#: The same of the trace of a pulse.
_TRACE_BYTES: Final = 364
#: A board whose clock advanced by this much less than the host's was off in between.
_CLOCK_LAG_S: Final = 2.0
_REMEDIES: Final[dict[int, str]] = {
    Refusal.LATCHED: "clear the fault first",
    Refusal.NOT_HOMED: "contid home",
    Refusal.NO_SENSOR: "check the wire of the pressure signal or load cell",
    Refusal.PERSISTS: "remove its cause",
    Refusal.OTHER_PORT: "end the other host, or use its port",
    Refusal.ARMED_NOW: "stop the robot first",
    Refusal.POSITION_LOST: "park it at power_up_deg, then contid home --parked",
}


def ask_hello(name: str, options: DueBusOptions) -> Hello:
    """Hello of the board at the port; sends nothing else.

    Raises:
        DeviceNotFoundError: the port is missing, or no board answers.
    """
    port = DuePort(name, find_port(name, options.port))
    try:
        return _wait_for_hello(name, options, port)
    finally:
        port.close()


def _wait_for_hello(name: str, options: DueBusOptions, port: DuePort) -> Hello:
    deadline = time.monotonic() + options.hello_ms / 1000.0
    sequence = 0
    while time.monotonic() < deadline:
        sequence = (sequence + 1) & 0xFF
        payload = port.ask(messages.request(Type.HELLO, sequence), time.monotonic() + _HELLO_EVERY_S)
        try:
            answer = None if payload is None else messages.read_answer(payload).answer
        except messages.BadAnswerError as error:
            raise DeviceNotFoundError(name, str(error), "contid firmware flash") from error
        if isinstance(answer, Hello):
            return answer
        if isinstance(answer, Refused):
            raise _refusal(name, "hello", answer)
    raise DeviceNotFoundError(
        name,
        f"no hello from {port.path} within {options.hello_ms:g} ms",
        "check that the contid sketch is on the board (contid firmware flash) and that the port is right",
    )


def _other_port(answer: Refused) -> str:
    return f"another host commands the board through its {PORTS[answer.detail]} port"


def _refusal(name: str, what: str, answer: Refused) -> DeviceNotFoundError:
    remedy = ""
    if answer.refusal == Refusal.WRONG_VERSION:
        remedy = (
            f"the board has protocol {answer.detail}, this contid {PROTOCOL_VERSION}: contid firmware flash"
        )
    elif answer.refusal == Refusal.OTHER_PORT:
        return DeviceNotFoundError(name, _other_port(answer), _REMEDIES[Refusal.OTHER_PORT])
    elif answer.refusal == Refusal.ARMED_NOW:
        remedy = (
            "another host armed it with another configuration: its watchdog will disarm it; or a motor holds "
            "its position by another wiring or zero: relax it with the former file, or switch its power off"
        )
    return DeviceNotFoundError(name, f"{what} refused: {answer.message}", remedy)


class DueConnection:
    """One connection to one board, from hello to its loss."""

    def __init__(self, name: str, options: DueBusOptions, axes: Sequence[AxisOnBus]) -> None:
        self._name = name
        self._options = options
        self._sequence = 0
        self._port = DuePort(name, find_port(name, options.port))
        self.clock = BoardClock()
        self.echo_ms = 0
        self._echo_s = -math.inf
        self.memory = memory_of(name, options.port, self._port.path, axes)
        try:
            self.hello = _wait_for_hello(name, options, self._port)
            if self.memory is not None:
                identity.require_known(name, self._port.path, self.hello, self.memory)
            self._follow_clock(self.hello.uptime_ms, time.monotonic())
            self._check_board()
            self._check_role()
            self._check_channels(axes)
            adc = Adc(self.hello.adc_steps, self.hello.adc_mv)
            self._blob = board_config(name, options, axes, adc)
            self.config_crc = crc16(self._blob)
            self._configure(axes)
        except BaseException:
            self.close()
            raise

    def _request(self, kind: Type, body: bytes, seconds: float) -> Answer | None:
        self._sequence = (self._sequence + 1) & 0xFF
        payload = self._port.ask(messages.request(kind, self._sequence, body), time.monotonic() + seconds)
        try:
            return None if payload is None else messages.read_answer(payload).answer
        except messages.BadAnswerError:
            return None  # noise passes the CRC once in 65536 times

    def _check_board(self) -> None:
        expected, found = self._options.board_id, self.hello.unique_id
        if expected not in (None, found):
            raise DeviceNotFoundError(
                self._name,
                f"expected board {expected} at {self._port.path}, found board {found}",
                "swap the ports or the boards, or correct board_id in the robot file",
            )

    def _check_role(self) -> None:
        if self.hello.role_name != self._options.role:
            raise DeviceNotFoundError(
                self._name,
                f"expected a {self._options.role} board at {self._port.path}, "
                f"found a {self.hello.role_name} board",
                "swap the ports in the robot file, or set the board's jumper (docs/devices/due.md)",
            )

    def _check_channels(self, axes: Sequence[AxisOnBus]) -> None:
        fitted = [i for i, capability in enumerate(self.hello.capabilities) if capability]
        missing = [axis.name for axis in axes if axis_options(axis).number not in fitted]
        if missing:
            raise DeviceNotFoundError(
                self._name,
                f"expected channels of {', '.join(missing)}, "
                f"found channels {', '.join(map(str, fitted)) or 'none'}",
                "see the pin map in contid doctor",
            )
        for axis in axes:
            self._check_parts(axis)

    def _check_parts(self, axis: AxisOnBus) -> None:
        o = axis_options(axis)
        name, parts = f"{self._name}: {axis.name}", self.hello.capabilities[o.number]
        if o.valves is not None and not parts & VALVE_PAIR:
            raise DeviceError(
                name,
                f"expected lines for two valves on {o.channel}, found none",
                "contid firmware flash (from 1.6.0); a Teensy has them on p0 to p3",
            )
        if o.kind is not DeviceKind.MOTOR:
            return
        if o.tension is not None:
            converter = o.tension.cell == "converter"
            if not parts & (CELL_CONVERTER if converter else CELL_ANALOG):
                lines = "lines for a converter of a load cell" if converter else "a pin for a load cell"
                raise DeviceError(
                    name, f"expected {lines} on {o.channel}, found none", "contid firmware flash (from 1.7.0)"
                )
        if not self.hello.bridges >> o.bridge.code & 1:
            bridges = ", ".join(one for one in Bridge if self.hello.bridges >> one.code & 1)
            raise DeviceError(name, f"expected a board for {o.bridge} bridges, found one for {bridges}")
        if o.stall_current_ma and not parts & CURRENT_SENSE:
            raise DeviceError(
                name,
                f"expected a current sensor on {o.channel}, found none",
                "see the pin map in contid doctor, or leave stall_current_ma out",
            )

    def _configure(self, axes: Sequence[AxisOnBus]) -> None:
        body = config_body(self._blob)
        seconds = len(body) * self._port.byte_s + 0.2
        answer = self._request(Type.CONFIGURE, body, seconds) or self._request(Type.CONFIGURE, body, seconds)
        if isinstance(answer, Refused):
            if answer.refusal == Refusal.BAD_VALUE and (
                where := refused_value(self._blob, axes, answer.detail)
            ):
                message = f"{where} is beyond what the board takes"
                raise DeviceNotFoundError(
                    self._name, message, "correct the key it comes from; units: firmware/PROTOCOL.md"
                )
            raise _refusal(self._name, "configuration", answer)
        if not isinstance(answer, Configured) or answer.config_crc != self.config_crc:
            raise DeviceNotFoundError(
                self._name, f"the board did not confirm configuration {self.config_crc:#06x}, got {answer}"
            )

    def trace(self) -> PulseTrace | None:
        """The trace of the newest pulse; None after the time-out."""
        seconds = (_TRACE_BYTES + 8) * self._port.byte_s + self._options.latency_ms / 1000.0
        answer = self._request(Type.TRACE, messages.trace(self.config_crc), seconds)
        return answer if isinstance(answer, PulseTrace) else None

    def command(self, kind: Type, body: bytes) -> Telemetry | Refused | None:
        """Send a request that a telemetry answers; None after the time-out.

        Raises:
            DeviceLostError: the port is gone, or the board was reset since hello.
        """
        # The programming port bounds the time of both ports.
        size = len(body) + 8 + _TELEMETRY_BYTES
        seconds = size * self._port.byte_s + self._options.latency_ms / 1000.0
        asked_s = time.monotonic()
        answer = self._request(kind, body, seconds)
        if isinstance(answer, Refused) and answer.refusal in (Refusal.NOT_CONFIGURED, Refusal.WRONG_CRC):
            hello = self._request(Type.HELLO, b"", seconds)
            cause = hello.cause.message if isinstance(hello, Hello) else "unknown"
            self._lost_by_reset(cause)
        if isinstance(answer, Refused) and answer.refusal == Refusal.OTHER_PORT:
            self.close()
            raise DeviceLostError(self._name, _other_port(answer), _REMEDIES[Refusal.OTHER_PORT])
        if isinstance(answer, Telemetry):
            self.clock.update(answer.uptime_ms, answer.age_us, asked_s, time.monotonic())
            restarted = answer.boot_id != self.hello.boot_id or not answer.configured
            if restarted or not self._follow_clock(answer.uptime_ms, asked_s):
                self._lost_by_reset(answer.cause.message)
            return answer
        return answer if isinstance(answer, Refused) else None

    def _follow_clock(self, uptime_ms: int, asked_s: float) -> bool:
        """Store the board's time of an answer; false when its clock started anew since the last one."""
        # The uptime wraps after 49 days; half of its range separates later from earlier.
        advanced_ms = (uptime_ms - self.echo_ms) & 0xFFFF_FFFF
        lag_s = asked_s - self._echo_s - advanced_ms / 1000.0
        self.echo_ms = uptime_ms
        first, self._echo_s = self._echo_s == -math.inf, time.monotonic()
        return first or (advanced_ms < 0x8000_0000 and lag_s < _CLOCK_LAG_S)

    def _lost_by_reset(self, cause: str) -> None:
        self.close()
        raise DeviceLostError(
            self._name,
            f"the board was reset (cause: {cause}) or exchanged; its configuration and counts are gone",
        )

    def close(self) -> None:
        """Close the port; idempotent. The board's watchdog stops what is armed."""
        self._port.close()


class BoardRefusedError(DeviceError):
    """The board did not grant a request, or did not answer it.

    Attributes:
        refusal: why; None without an answer.
    """

    def __init__(self, name: str, what: str, axes: Sequence[str], answer: Refused | None) -> None:
        message = "no answer" if answer is None else answer.message
        remedy = "" if answer is None else _REMEDIES.get(answer.refusal, "")
        super().__init__(name, f"{what} {', '.join(axes)}: {message}", remedy)
        self.refusal = None if answer is None else answer.refusal
