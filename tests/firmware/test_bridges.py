"""The lines of every H-bridge at the pins of the emulated SAM3X, read with the truth tables of the parts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import pytest

from contid.hal import AxisOnBus
from contid_drivers.due import frames, messages, wiring
from contid_drivers.due.codes import DUTY_FULL, BoardState, RestCode, Type
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role
from tests.firmware.sam3x.board import Sam3x
from tests.firmware.sam3x.build import build_sketch

#: Time of a motion [ms]: the shaft of this bench stands, which the board notices after some 60 ms.
PUSH_MS = 18
#: Channel m0: PWM on D9 (PC21, unit 4), inputs on D38 (PC6) and D39 (PC7).
UNIT, PWM_BIT, A_BIT, B_BIT = 4, 21, 6, 7
#: Data sheets: levels of (PWM, a, b) -> what the part does; "+" and "-" drive.
VNH5019: Final[Mapping[tuple[int, int, int], str]] = {
    (1, 1, 0): "+", (1, 0, 1): "-", (1, 1, 1): "brake", (1, 0, 0): "brake", (0, 1, 0): "coast",
    (0, 0, 1): "coast", (0, 0, 0): "coast", (0, 1, 1): "coast",
}  # fmt: skip
TB6612: Final[Mapping[tuple[int, int, int], str]] = {
    (1, 1, 1): "brake", (0, 1, 1): "brake", (1, 0, 1): "-", (0, 0, 1): "brake", (1, 1, 0): "+",
    (0, 1, 0): "brake", (1, 0, 0): "coast",
}  # fmt: skip
#: DRV8871: IN1 = PWM, IN2 = a.
DRV8871: Final[Mapping[tuple[int, int, int], str]] = {
    (0, 0, 0): "coast", (1, 0, 0): "+", (0, 1, 0): "-", (1, 1, 0): "brake",
}  # fmt: skip
#: DRV8838: PH = a, EN = PWM; PH high is reverse.
DRV8838: Final[Mapping[tuple[int, int, int], str]] = {
    (0, 0, 0): "brake", (0, 1, 0): "brake", (1, 0, 0): "+", (1, 1, 0): "-",
}  # fmt: skip
PARTS = [
    ("pwm_in_in", VNH5019, "coast"), ("tb6612", TB6612, "coast"), ("in_in", DRV8871, "coast"),
    ("dir_pwm", DRV8838, "brake"),
]  # fmt: skip


class Bench:
    """A board with one motor, asked over the programming port; the shaft stands."""

    def __init__(self, bridge: str, start: str) -> None:
        self.board = Sam3x(build_sketch())
        self.board.run_ms(20)
        options = {
            "channel": "m0",
            "bridge": bridge,
            "start_state": start,
            "on_watchdog": start,
            "stall_ms": 5000,
        }
        axis = AxisOnBus("a", DueAxisOptions.model_validate(options))
        blob = wiring.board_config("b", DueBusOptions(port="x", role=Role.MOTOR, watchdog_ms=500), [axis])
        self.crc = frames.crc16(blob)
        self.ask(Type.CONFIGURE, wiring.config_body(blob))
        self.echo_ms = 0
        self.demand()

    def ask(self, kind: Type, body: bytes) -> messages.Answer:
        payload = frames.unseal(self.board.ask_uart(frames.seal(messages.request(kind, 7, body)))[:-1])
        assert payload is not None
        return messages.read_answer(payload)[1]

    def demand(self, goals: Mapping[int, int] | None = None) -> messages.BoardReport:
        answer = self.ask(Type.DEMAND, messages.demand(self.crc, self.echo_ms, goals or {}))
        assert isinstance(answer, messages.Telemetry), answer
        self.echo_ms = answer.uptime_ms
        return answer.channels[0]

    def shares(self, part: Mapping[tuple[int, int, int], str]) -> dict[str, float]:
        """What the part does, and for which share of a PWM period."""
        self.board.run_ms(2)
        port = self.board.pio["C"]
        for bit in (A_BIT, B_BIT):
            assert port.read(0x18) & 1 << bit, "driven"
        assert not port.read(0x08) & 1 << PWM_BIT, "driven by the PWM unit"
        a, b = port.read(0x38) >> A_BIT & 1, port.read(0x38) >> B_BIT & 1
        duty = self.board.pwm.channel(UNIT, 0x04) / self.board.pwm.channel(UNIT, 0x0C)
        found: dict[str, float] = {}
        for level, share in ((1, duty), (0, 1.0 - duty)):
            if share > 0:
                action = part[level, a, b]
                found[action] = found.get(action, 0.0) + share
        return found


@pytest.mark.slow
@pytest.mark.parametrize(("bridge", "part", "released"), PARTS)
def test_a_bridge_does_what_the_board_means(
    bridge: str, part: Mapping[tuple[int, int, int], str], released: str
):
    bench = Bench(bridge, "brake")
    assert bench.shares(part) == {"brake": 1.0}  # READY: as its wiring in a reset
    for goal in (300, -300):
        bench.ask(Type.ARM, messages.mask_body(bench.crc, [0]))
        bench.demand({0: goal})
        bench.board.run_ms(PUSH_MS)
        report = bench.demand({0: goal})
        assert report.state is BoardState.ARMED
        shares = bench.shares(part)
        # The drive of a shaft that stands rises between the two looks.
        assert shares["+" if goal > 0 else "-"] == pytest.approx(abs(report.duty) / DUTY_FULL, abs=0.15)
        assert ("-" if goal > 0 else "+") not in shares
        assert abs(report.duty) > 0.05 * DUTY_FULL
        bench.ask(Type.STOP, messages.stop([0], RestCode.RELAX))
        assert bench.shares(part) == {released: 1.0}


@pytest.mark.parametrize(("bridge", "part", "released"), PARTS[:3])
def test_a_bridge_that_is_pulled_down_coasts(
    bridge: str, part: Mapping[tuple[int, int, int], str], released: str
):
    assert Bench(bridge, "coast").shares(part) == {released: 1.0}


@pytest.mark.parametrize(("bridge", "part", "released"), PARTS)
def test_pull_resistors_alone_give_the_start_state(
    bridge: str, part: Mapping[tuple[int, int, int], str], released: str
):
    """docs/devices/due.md, table of bridges: levels of (PWM, a, b) by the resistors."""
    pulls = {
        "pwm_in_in": {"brake": (1, 1, 1), "coast": (0, 0, 0)},
        "tb6612": {"brake": (1, 1, 1), "coast": (1, 0, 0)},
        "in_in": {"brake": (1, 1, 0), "coast": (0, 0, 0)},
        "dir_pwm": {"brake": (0, 0, 0)},
    }
    for state, levels in pulls[bridge].items():
        assert part[levels] == state
