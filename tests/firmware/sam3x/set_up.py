"""What the sketch's set-up must leave in the registers of a motor board, 20 ms after its start."""

from __future__ import annotations

import pytest

from contid_drivers.due import frames, messages
from contid_drivers.due.codes import Type
from tests.firmware.sam3x.board import Sam3x
from tests.firmware.sam3x.cpu import CLOCK_HZ
from tests.firmware.sam3x.plant import ANALOG, CELLS, PWM_LINES

#: Index of the serial number in the core's device descriptor.
SERIAL_NUMBER = 3
PIOD, TC3, UOTGHS, UART = 14, 30, 40, 8


def serial_number(unique_id: bytes) -> str:
    """FNV-1a with 64 bits (Fowler, Noll, Vo) of the chip's id, as hexadecimal digits."""
    value = 0xCBF29CE484222325
    for byte in unique_id:
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return f"{value:016X}"


def every_pwm_channel_runs_at_20_khz_on_its_own(motors: Sam3x) -> None:
    for unit, bit in PWM_LINES:
        assert motors.pwm.enabled & 1 << unit
        assert motors.pwm.frequency_hz(unit) == pytest.approx(20_000)
        assert motors.pwm.channel(unit, 0x0C) == 4200
        assert motors.pwm.channel(unit, 0x04) == 0, "the duty is 0 until a channel is armed"
        # Left-aligned, CPOL 0: the low output, which the pins carry, is high for CDTY steps.
        assert motors.pwm.channel(unit, 0x00) & (1 << 8 | 1 << 9) == 0
        port = motors.pio["C"]
        assert port.read(0x08) & 1 << bit, "not driven before the channel is configured"
        assert not port.read(0x18) & 1 << bit
        assert port.read(0x70) & 1 << bit, "peripheral B"
    assert sorted(unit for unit, _ in motors.pwm.modes) == sorted(unit for unit, _ in PWM_LINES)
    assert motors.pmc.clocks >> 36 & 1


def bridges_are_left_to_their_wiring(motors: Sam3x) -> None:
    c, a = motors.pio["C"], motors.pio["A"]
    inputs = [(c, bit) for bit in (6, 7, 8, 9, 14, 15, 16, 17, 18, 19)] + [(a, 19), (a, 20)]
    for port, bit in inputs:
        assert port.read(0x08) & 1 << bit, "no peripheral"
        assert not port.read(0x18) & 1 << bit, "an input"
        assert port.read(0x68) & 1 << bit, "without pull-up"


def decoders_filter_and_count_every_edge(motors: Sam3x) -> None:
    for block, pins in ((0, ("B", 25, "B", 27)), (2, ("C", 25, "C", 26))):
        tc = motors.tc[block]
        assert tc.running
        mode = tc.read(0xC4)
        assert mode >> 8 & 3 == 3, "QDEN, POSEN"
        assert mode >> 12 & 1, "EDGPHA: edges of both tracks"
        assert mode >> 19 & 1, "FILTER"
        assert mode >> 20 & 0x3F == 63, "MAXFILT"
        assert tc.read(0x04) & 7 == 5, "clocked by XC0"
        for port, bit in zip(pins[::2], pins[1::2], strict=True):
            assert motors.pio[str(port)].read(0x70) & 1 << int(bit), "peripheral B"
            assert motors.pio[str(port)].read(0x68) & 1 << int(bit) == 0, "pull-up on"
        assert motors.pmc.clocks >> 27 + 3 * block & 1


def edge_inputs_are_debounced(motors: Sam3x) -> None:
    pins = 0b110_1100_1111  # PD0 to PD3, PD6, PD7, PD9, PD10
    port = motors.pio["D"]
    for status in (0x28, 0x88, 0x48):  # filter on, by the slow clock, interrupt on
        assert port.read(status) & pins == pins
    assert port.read(0x8C) == 0
    assert port.read(0x68) & pins == 0, "pull-ups on"


def the_adc_converts_currents_and_load_cells(motors: Sam3x) -> None:
    assert motors.adc.enabled == sum(1 << channel for channel in (*ANALOG, *CELLS))


def priorities(motors: Sam3x) -> None:
    system = motors.cpu.system
    priority = {irq: system.priority[16 + irq] >> 4 for irq in (PIOD, TC3, UOTGHS)}
    assert priority[PIOD] < priority[TC3] < priority[UOTGHS]
    assert system.enabled >> UART & 1 == 0, "the UART moves bytes by DMA"
    assert system.enabled >> TC3 & 1
    assert system.enabled >> PIOD & 1


def the_watchdog_resets_within_50_ms(motors: Sam3x) -> None:
    mode = motors.watchdog.mode
    assert mode >> 15 & 1 == 0, "not disabled"
    assert mode >> 13 & 1, "it resets"
    assert mode >> 16 & 0xFFF >= mode & 0xFFF, "feeding it early is no error"
    assert 0.020 <= motors.watchdog.period_s <= 0.050
    # The slow RC oscillator has 20 to 44 kHz instead of 32.768.
    assert motors.watchdog.period_s * 32768 / 20_000 < 0.055


def the_tick_is_1_khz(motors: Sam3x) -> None:
    before = motors.tc[1].ticks
    motors.run_ms(50)
    assert motors.tc[1].ticks - before in (49, 50, 51)
    assert motors.cpu.exceptions[16 + TC3] >= motors.tc[1].ticks - 1
    assert 2 * motors.tc[1].read(0x1C) == CLOCK_HZ // 1000


CHECKS = (
    every_pwm_channel_runs_at_20_khz_on_its_own,
    bridges_are_left_to_their_wiring,
    decoders_filter_and_count_every_edge,
    edge_inputs_are_debounced,
    the_adc_converts_currents_and_load_cells,
    priorities,
    the_watchdog_resets_within_50_ms,
    the_tick_is_1_khz,
)


def hello(board: Sam3x) -> messages.Hello:
    payload = frames.unseal(board.ask_uart(frames.seal(messages.request(Type.HELLO, 7, b"")))[:-1])
    assert payload is not None
    sequence, answer = messages.read_answer(payload)
    assert isinstance(answer, messages.Hello)
    assert sequence == 7
    return answer
