"""The steps of one motor: what ends them."""

from __future__ import annotations

from collections.abc import Callable

from contid_bringup.motor import bring_up_motor
from contid_bringup.wiring_faults import WiringFault
from contid_devices.pulsed_motors import DriveFacts, PulseAnswer
from tests.support.shafts.shaft_plant import Bench, Shaft, Wires

AXIS = "arm.x"
FACTS = DriveFacts(4776.0, True, 0.05, 575.0, 0.04)


class Sees:
    """A person who sees the same every time, and turns a shaft when asked."""

    def __init__(self, seen: WiringFault) -> None:
        self.seen = seen

    def turned(self, axis: str) -> bool:
        return True

    def saw(self, axis: str, wiggle: Callable[[], None]) -> WiringFault:
        wiggle()
        return self.seen


class Trips(Bench):
    """A bench whose bridge refuses a late pulse; nothing may be pulsed after it."""

    def pulse(self, axis: str, duty: float, duration_s: float) -> PulseAnswer:
        assert not self.wires[axis].fault_line, "pulsed after a fault"
        if abs(duty) >= 0.19:
            self.wires[axis].fault_line = True
        return super().pulse(axis, duty, duration_s)


def test_a_bridge_that_trips_while_the_motor_is_measured_is_not_proven() -> None:
    bench = Trips([Shaft()], {AXIS: Wires(shaft=0)})
    found = bring_up_motor(bench, AXIS, FACTS, lambda _line: None, Sees(WiringFault.NONE))
    assert found.name == "bridge-trips"
    assert found.fit is None
    assert found.counts_by_hand is None


def test_what_a_person_sees_is_the_verdict_and_the_wiggle_begins_as_the_value_rises() -> None:
    bench = Bench([Shaft()], {AXIS: Wires(shaft=0)})
    person = Sees(WiringFault.OTHER_TURNED)
    found = bring_up_motor(bench, AXIS, FACTS, lambda _line: None, person, sense=-1)
    assert found.name == "other-part"
    assert found.counts_by_hand is None
    wiggled = [duty for _, duty, _ in bench.pulses[found.pulses :] if duty]
    assert wiggled[0] < 0.0 < max(wiggled)
