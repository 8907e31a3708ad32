"""A load cell at the pins of the whole sketch: the floor of tension, and a brake when the tendon is cut."""

from __future__ import annotations

import pytest

from contid.hal import AxisOnBus
from contid_drivers.due.codes import BoardState, Reason
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role
from tests.firmware.sam3x.board import Sam3x
from tests.firmware.sam3x.build import build_sketch
from tests.firmware.sam3x.host import Host
from tests.firmware.sam3x.plant import ADC_MV, Motors
from tests.firmware.tendons.trials import AMPLIFIER

pytestmark = [pytest.mark.process, pytest.mark.campaign]

#: Channel of the converter at A6, by the data sheet.
A6 = 1
DEGREE = 4776 / 360.0
N_PER_DEG = 0.5
TENSION = {**AMPLIFIER, "stiffness_n_per_deg": N_PER_DEG}


class Tendons(Motors):
    """The first motor winds a tendon to a body that stands: 3 N at its start, without any when cut."""

    cut = False
    ticks = 0

    def fire(self) -> None:
        super().fire()
        self.ticks += 1
        noise = self.ticks * 7919 % 5 - 2
        millivolt = self.tension() * (3100.0 - 200.0) / 50.0 + 200.0
        self._board.adc.analog[A6] = int(millivolt / ADC_MV * 4095) + noise

    def tension(self) -> float:
        return 0.0 if self.cut else max(0.0, 3.0 + self.shaft[0] / DEGREE * N_PER_DEG)


def test_the_floor_and_a_snap_on_the_whole_sketch() -> None:
    board = Sam3x(build_sketch())
    board.adc.analog[A6] = 465
    board.run_ms(25)
    board.usb.plug()
    board.run_ms(25)
    if not board.usb.opened:
        board.usb.open()
    plant, host = Tendons(board), Host(board.ask_usb)
    keys = {"channel": "m0", "start_state": "brake", "tension": TENSION}
    axes = [AxisOnBus("m0", DueAxisOptions.model_validate(keys), (-60.0, 60.0))]
    host.configure_axes(axes, DueBusOptions(port="x", role=Role.MOTOR))
    board.run_ms(10)
    host.arm(1)
    least = 3.0
    for _ in range(50):
        host.demand({0: round(-20 * DEGREE)})
        board.run_ms(10)
        least = min(least, plant.tension())
    host.demand({})
    assert host.telemetry is not None
    assert plant.tension() == pytest.approx(1.1, abs=0.15)
    assert least > 0.9
    tension_mn = host.telemetry.channels[0].tension_mn
    assert tension_mn is not None
    assert tension_mn / 1000.0 == pytest.approx(plant.tension(), abs=0.1)
    plant.cut = True
    board.run_ms(20)
    assert not plant.duty(0)  # a brake
    host.demand({})
    report = host.telemetry.channels[0]
    assert (report.state, report.reason) == (BoardState.SAFE, Reason.SNAP)
