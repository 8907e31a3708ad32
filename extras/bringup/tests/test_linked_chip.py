"""Bring-up of motors on the machine code of the sketch: the whole ELF on an emulated SAM3X8E, to its pins."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from contid.hal.pulses import EncoderAnswer
from contid_bringup.naming import name_fault
from contid_bringup.probing import probe
from contid_bringup.wiring_faults import WiringFault
from contid_devices.pulsed_motors import DriveFacts, PulseAnswer
from contid_drivers.due import messages
from contid_drivers.due.codes import DUTY_FULL, TRACE_MS, Type
from tests.firmware.sam3x.board import Sam3x
from tests.firmware.sam3x.build import build_sketch
from tests.firmware.sam3x.host import Host
from tests.firmware.sam3x.plant import EDGE_BITS, STEP, Motors

pytestmark = [pytest.mark.process, pytest.mark.slow, pytest.mark.campaign]

#: What `Motors` are, and the counts of the robot file.
FACTS = DriveFacts(4776.0, True, 0.05, 575.0, 0.04)
DEGREE = 4776 / 360.0


def swap_encoders(plant: Motors) -> None:
    plant.encoder_of[2], plant.encoder_of[3] = 3, 2


def reverse(plant: Motors) -> None:
    plant.sense[2] = -1


@pytest.mark.parametrize(
    ("wire", "expected"),
    [
        (lambda plant: None, WiringFault.NONE),
        (reverse, WiringFault.REVERSED),
        (swap_encoders, WiringFault.CROSSED_AXES),
        (lambda plant: plant.open(2), WiringFault.TRACK_A),
    ],
    ids=["healthy", "reversed", "swapped", "track"],
)
def test_the_wiring_of_a_motor_at_the_pins(wire: Callable[[Motors], None], expected: WiringFault) -> None:
    chip = Sam3x(build_sketch(), cycles_per_instruction=6.0)  # fewer are emulated per millisecond
    chip.run_ms(25)
    chip.usb.open()
    chip.cpu.quantum = 512
    plant, host = Motors(chip, step=4 * STEP), Host(chip.ask_usb)
    # The tracks that count at pins stand low from the start, as the plant has them at its count 0.
    for bit in EDGE_BITS.values():
        chip.pio["D"].set_levels(3 << bit, 0)
    host.configure(4)
    wire(plant)
    start, farthest = list(plant.shaft), 0.0

    def pulse(duty: float, duration_s: float) -> PulseAnswer:
        nonlocal farthest
        host.demand({})
        assert host.telemetry is not None
        order = (host.crc, host.telemetry.uptime_ms, 2, round(duty * DUTY_FULL), round(duration_s * 1e3))
        assert isinstance(host.ask(Type.PULSE, messages.pulse(*order)), messages.Telemetry)
        chip.run_ms(TRACE_MS + 2)
        trace = host.ask(Type.TRACE, messages.trace(host.crc))
        assert isinstance(trace, messages.PulseTrace)
        farthest = max(farthest, *(abs(a - b) / DEGREE for a, b in zip(plant.shaft, start, strict=True)))
        encoders = {f"m{i}": EncoderAnswer(*each) for i, each in enumerate(trace.encoders[:4])}
        duty = trace.duty / DUTY_FULL
        return PulseAnswer("m2", duty, duration_s, trace.driven_ms / 1e3, encoders, trace.positions)

    verdict = name_fault(probe(pulse, FACTS))
    assert verdict.fault is expected
    assert verdict.other == ("m3" if expected is WiringFault.CROSSED_AXES else "")
    assert farthest <= 2.0
    assert chip.resets == 0
