"""The conversation with one board: hello, configuration, requests with time-outs, and noticing a reset."""

from __future__ import annotations

import time
from collections.abc import Sequence

from contid.errors import DeviceError, DeviceLostError, DeviceNotFoundError
from contid.hal import AxisOnBus
from contid_drivers.due import messages
from contid_drivers.due.codes import PROTOCOL_VERSION, Refusal, Type
from contid_drivers.due.frames import crc16
from contid_drivers.due.messages import Answer, Configured, Hello, Refused, Telemetry
from contid_drivers.due.options import DueBusOptions
from contid_drivers.due.port import DuePort
from contid_drivers.due.wiring import axis_options, board_config, config_body
from contid_drivers.serial_ports import find_port

#: How often hello is repeated while a board starts.
_HELLO_EVERY_S = 0.05
#: Bytes of the longest telemetry frame, for its time on the wire.
_TELEMETRY_BYTES = 112


def ask_hello(name: str, options: DueBusOptions) -> Hello:
    """What the board at the port says of itself; nothing else is said to it.

    Raises:
        DeviceNotFoundError: the port is missing, or nobody says hello.
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
            answer = None if payload is None else messages.read_answer(payload)[1]
        except messages.BadAnswerError as error:
            raise DeviceNotFoundError(name, str(error), "contid firmware flash") from error
        if isinstance(answer, Hello):
            return answer
        if isinstance(answer, Refused):
            raise _refusal(name, "hello", answer)
    raise DeviceNotFoundError(
        name,
        f"no hello from {port.path} within {options.hello_ms:g} ms",
        "is the contid sketch on the board? (contid firmware flash); is this the right port?",
    )


def _refusal(name: str, what: str, answer: Refused) -> DeviceNotFoundError:
    remedy = ""
    if answer.refusal == Refusal.WRONG_VERSION:
        remedy = (
            f"the board speaks protocol {answer.detail}, this contid {PROTOCOL_VERSION}: "
            "contid firmware flash"
        )
    elif answer.refusal == Refusal.ARMED_NOW:
        remedy = "another host armed it with another configuration; its dead-man will disarm it"
    return DeviceNotFoundError(name, f"{what} refused: {answer.message}", remedy)


class DueConnection:
    """One connection to one board, from hello to its loss."""

    def __init__(self, name: str, options: DueBusOptions, axes: Sequence[AxisOnBus]) -> None:
        self._name = name
        self._options = options
        self._blob = board_config(name, options, axes)
        self.config_crc = crc16(self._blob)
        self._sequence = 0
        self._port = DuePort(name, find_port(name, options.port))
        self.heard_ms = 0
        try:
            self.hello = _wait_for_hello(name, options, self._port)
            self.heard_ms = self.hello.uptime_ms
            self._check_role()
            self._check_channels(axes)
            self._configure()
        except BaseException:
            self.close()
            raise

    def _request(self, kind: Type, body: bytes, seconds: float) -> Answer | None:
        self._sequence = (self._sequence + 1) & 0xFF
        payload = self._port.ask(messages.request(kind, self._sequence, body), time.monotonic() + seconds)
        try:
            return None if payload is None else messages.read_answer(payload)[1]
        except messages.BadAnswerError:
            # Garbage with a good CRC happens once in 65536 times; it is no answer.
            return None

    def _check_role(self) -> None:
        if self.hello.role_name != self._options.role:
            raise DeviceNotFoundError(
                self._name,
                f"expected a {self._options.role} board at {self._port.path}, "
                f"found a {self.hello.role_name} board",
                "swap the ports in the robot file, or set the board's jumper (docs/due.md)",
            )

    def _check_channels(self, axes: Sequence[AxisOnBus]) -> None:
        fitted = [i for i, capability in enumerate(self.hello.capabilities) if capability]
        missing = [axis.name for axis in axes if axis_options(axis).number not in fitted]
        if missing:
            raise DeviceNotFoundError(
                self._name,
                f"expected channels of {', '.join(missing)}, "
                f"found channels {', '.join(map(str, fitted)) or 'none'}",
                "the pin map in hello (contid doctor) says what the board was built for",
            )

    def _configure(self) -> None:
        body = config_body(self._blob)
        seconds = self._port.wire_seconds(len(body)) + 0.2
        answer = self._request(Type.CONFIGURE, body, seconds) or self._request(Type.CONFIGURE, body, seconds)
        if isinstance(answer, Refused):
            raise _refusal(self._name, "configuration", answer)
        if not isinstance(answer, Configured) or answer.config_crc != self.config_crc:
            raise DeviceNotFoundError(
                self._name, f"the board did not confirm configuration {self.config_crc:#06x}, got {answer}"
            )

    def command(self, kind: Type, body: bytes) -> Telemetry | Refused | None:
        """One request whose answer is a telemetry; None when it did not come in time.

        Raises:
            DeviceLostError: the port is gone, or the board was reset since hello.
        """
        # On the native port the bytes take no time worth counting; the slower port bounds both.
        size = len(body) + 8 + _TELEMETRY_BYTES
        seconds = self._port.wire_seconds(size) + self._options.latency_ms / 1000.0
        answer = self._request(kind, body, seconds)
        if isinstance(answer, Refused) and answer.refusal in (Refusal.NOT_CONFIGURED, Refusal.WRONG_CRC):
            hello = self._request(Type.HELLO, b"", seconds)
            cause = hello.cause.message if isinstance(hello, Hello) else "unknown"
            self._lost_by_reset(cause)
        if isinstance(answer, Telemetry):
            # The uptime wraps after 49 days; half of its range tells later from earlier.
            earlier = (answer.uptime_ms - self.heard_ms) & 0xFFFF_FFFF > 0x8000_0000
            if answer.boot != self.hello.boot or earlier:
                self._lost_by_reset(answer.cause.message)
            self.heard_ms = answer.uptime_ms
            return answer
        return answer if isinstance(answer, Refused) else None

    def _lost_by_reset(self, cause: str) -> None:
        self.close()
        raise DeviceLostError(
            self._name, f"the board was reset (cause: {cause}); its configuration and counts are gone"
        )

    @property
    def damaged(self) -> int:
        """Frames that arrived damaged."""
        return self._port.reader.damaged

    def close(self) -> None:
        """Let the port go; idempotent, the board notices through its dead-man."""
        self._port.close()


def refused(name: str, what: str, axes: Sequence[str], answer: Refused | None) -> DeviceError:
    """The error for a request the board did not grant."""
    message = "no answer" if answer is None else answer.message
    remedy = {
        Refusal.LATCHED: "clear the fault first",
        Refusal.NOT_HOMED: "contid home",
        Refusal.NO_SENSOR: "look at the pressure signal's wire",
        Refusal.PERSISTS: "its cause is still there",
    }.get(
        Refusal(answer.refusal)
        if answer is not None and answer.refusal in set(Refusal)
        else Refusal.BAD_VALUE,
        "",
    )
    return DeviceError(name, f"{what} {', '.join(axes)}: {message}", remedy)
