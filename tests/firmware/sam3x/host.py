"""A host of an emulated board: configures, arms and streams demands over one of its ports."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from contid.hal import AxisOnBus
from contid_drivers.due import frames, messages, wiring
from contid_drivers.due.codes import Type
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role
from tests.firmware.sam3x.plant import VALVES


class Host:
    """``lost`` counts requests without a valid answer."""

    def __init__(self, ask: Callable[[bytes, float], bytes]) -> None:
        """``ask`` sends a request and returns the answer: `ask_usb` or `ask_uart` of a board."""
        self._ask = ask
        self.lost = 0
        self.sequence = 0
        self.crc = 0
        self.telemetry: messages.Telemetry | None = None

    def ask(self, kind: Type, body: bytes = b"", timeout_ms: float = 30) -> messages.Answer | None:
        self.sequence = (self.sequence + 1) & 0xFF
        answer = self._ask(frames.seal(messages.request(kind, self.sequence, body)), timeout_ms)
        payload = frames.unseal(answer[:-1]) if answer.endswith(b"\0") else None
        if payload is None:
            self.lost += 1
            return None
        sequence, message = messages.read_answer(payload)
        assert sequence == self.sequence
        if isinstance(message, messages.Telemetry):
            self.telemetry = message
        return message

    def configure(self, motors: int = 6, watchdog_ms: int = 100) -> None:
        axes = [
            AxisOnBus(f"m{i}", DueAxisOptions.model_validate({"channel": f"m{i}"}), (-10.0, 60.0))
            for i in range(motors)
        ]
        self.configure_axes(axes, DueBusOptions(port="x", role=Role.MOTOR, watchdog_ms=watchdog_ms))

    def configure_regulators(self, watchdog_ms: int = 100) -> None:
        """Six regulators as `plant.Regulators` has them."""
        wired = {"calibration": [[0, 0], [100, 3]], "readback": [[0, 0], [3125, 3]], "ceiling_bar": 1.6}
        axes = [
            AxisOnBus(f"p{i}", DueAxisOptions.model_validate({"channel": f"p{i}", **wired}), None)
            for i in range(6)
        ]
        self.configure_axes(axes, DueBusOptions(port="x", role=Role.PRESSURE, watchdog_ms=watchdog_ms))

    def configure_valves(self, count: int, watchdog_ms: int = 100) -> None:
        """Pairs of valves as `plant.Chambers` has them."""
        axes = [
            AxisOnBus(f"p{i}", DueAxisOptions.model_validate({"channel": f"p{i}", **VALVES}), None)
            for i in range(count)
        ]
        self.configure_axes(axes, DueBusOptions(port="x", role=Role.PRESSURE, watchdog_ms=watchdog_ms))

    def configure_axes(self, axes: Sequence[AxisOnBus], options: DueBusOptions) -> None:
        blob = wiring.board_config("b", options, axes)
        self.crc = frames.crc16(blob)
        answer = self.ask(Type.CONFIGURE, wiring.config_body(blob), timeout_ms=60)
        assert isinstance(answer, messages.Configured), answer

    def arm(self, motors: int = 6) -> None:
        self.demand({})
        answer = self.ask(Type.ARM, messages.mask_body(self.crc, range(motors)))
        assert isinstance(answer, messages.Telemetry), answer

    def demand(self, goals: Mapping[int, int], timeout_ms: float = 30) -> None:
        self.ask(Type.DEMAND, self._demand(goals), timeout_ms)

    def demand_frame(self, goals: Mapping[int, int]) -> bytes:
        """A demand for a caller that does not wait for the answer."""
        self.sequence = (self.sequence + 1) & 0xFF
        return frames.seal(messages.request(Type.DEMAND, self.sequence, self._demand(goals)))

    def _demand(self, goals: Mapping[int, int]) -> bytes:
        echo = self.telemetry.uptime_ms if self.telemetry else 0
        return messages.demand(self.crc, echo, goals)
