"""Encoder signals on the pins of the emulated SAM3X8E."""

from __future__ import annotations

import pytest

from contid_drivers.due.codes import BoardState, Reason
from tests.firmware.sam3x.board import Sam3x
from tests.firmware.sam3x.build import build_sketch
from tests.firmware.sam3x.host import Host
from tests.firmware.sam3x.plant import EDGE_BITS, Motors


@pytest.fixture
def board() -> Sam3x:
    made = Sam3x(build_sketch())
    made.run_ms(20)
    made.usb.open()
    return made


@pytest.fixture
def host(board: Sam3x) -> Host:
    return Host(board.ask_usb)


@pytest.mark.slow
def test_both_kinds_of_decoder_count_in_the_same_direction(board: Sam3x, host: Host):
    plant = Motors(board)
    host.configure()
    host.arm()
    for i in range(18):
        host.demand(dict.fromkeys(range(6), 20 * i))
        board.run_ms(10)
    host.demand({})
    assert host.telemetry is not None
    for channel, report in host.telemetry.channels.items():
        # The shaft goes on while the answer is on the wire, at 2 counts per ms.
        assert report.position == pytest.approx(plant.shaft[channel], abs=12)
        assert report.position > 200


@pytest.mark.parametrize("channel", [0, 1, 2, 5])
def test_missed_edges_put_the_motor_into_its_safe_state(board: Sam3x, host: Host, channel: int):
    host.configure()
    host.arm()
    for _ in range(8):
        if channel < 2:
            board.tc[2 * channel].quadrature_error = True
        else:  # both tracks change at once
            bit = EDGE_BITS[channel]
            board.pio["D"].set_levels(3 << bit, ~board.pio["D"].levels)
        host.demand({})
        board.run_ms(2)
    host.demand({})
    assert host.telemetry is not None
    report = host.telemetry.channels[channel]
    assert (report.state, report.reason) == (BoardState.SAFE, Reason.ENCODER_EDGES)
    others = {c: r.state for c, r in host.telemetry.channels.items() if c != channel}
    assert set(others.values()) == {BoardState.ARMED}


def test_channels_outside_the_configuration_do_not_interrupt(board: Sam3x, host: Host):
    host.configure(motors=3)
    board.run_ms(1)
    enabled = board.pio["D"].read(0x48)
    assert enabled & 0b11 == 0b11, "channel 2"
    assert enabled >> 2 == 0, "channels 3 to 5"
