"""The steps of one motor: what ends them."""

from __future__ import annotations

from contid.hal.pulses import DriveFacts, PulseAnswer
from contid_bringup.motor import bring_up_motor
from tests.support.shafts.shaft_plant import Bench, Shaft, Wires

AXIS = "arm.x"
FACTS = DriveFacts(4776.0, True, 0.05, 575.0, 0.04)


class Trips(Bench):
    """A bench whose bridge refuses a late pulse; nothing may be pulsed after it."""

    def pulse(self, axis: str, duty: float, duration_s: float) -> PulseAnswer:
        assert not self.wires[axis].fault_line, "pulsed after a fault"
        if abs(duty) >= 0.19:
            self.wires[axis].fault_line = True
        return super().pulse(axis, duty, duration_s)


def test_a_bridge_that_trips_while_the_motor_is_measured_is_not_proven() -> None:
    bench = Trips([Shaft()], {AXIS: Wires(shaft=0)})
    found = bring_up_motor(bench, AXIS, FACTS, lambda _line: None, lambda _axis: True)
    assert found.name == "bridge-trips"
    assert found.fit is None
    assert found.counts_by_hand is None
