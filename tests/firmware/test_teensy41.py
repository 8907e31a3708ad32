"""The sketch with the Teensy core on an emulated Cortex-M7: registers by the core's own tables, and the wire.

`CONTID_TEENSY_CORE` names the folder ``teensy4`` of a checkout of PaulStoffregen/cores.
"""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

import pytest

from contid_devices.due.firmware_build import firmware_dir
from contid_drivers.due import messages
from contid_drivers.due.codes import Type
from tests.firmware.sam3x.host import Host
from tests.firmware.teensy41.build import build_sketch
from tests.firmware.teensy41.chip import (
    BUS_HZ,
    ENCODERS,
    PIT_LDVAL,
    PIT_TCTRL,
    WATCHDOG,
    WDOG3_CS,
    WDOG3_TOVAL,
    Teensy41,
)

GIVEN = os.environ.get("CONTID_TEENSY_CORE")
MISSING = "CONTID_TEENSY_CORE names no folder teensy4 of the Teensy core, or there is no arm-none-eabi-g++"
needs_core = pytest.mark.skipif(GIVEN is None or shutil.which("arm-none-eabi-g++") is None, reason=MISSING)
PINS = (firmware_dir() / "contid_due/src/teensy41/pins.h").read_text()
FLEXPWM = {2: 0x403E_0000, 3: 0x403E_4000}
XBAR = 0x403B_C000


def numbers(name: str) -> list[list[int]]:
    """The innermost braces of a table of pins.h; false and true are 0 and 1."""
    body = PINS.split(f"{name}[")[1].split(";")[0].replace("false", "0").replace("true", "1")
    return [[int(n) for n in re.findall(r"\d+", row)] for row in re.findall(r"\{([\d, ]+)\}", body)]


PWM, BRIDGES, TRACKS = numbers("PWM_PINS"), numbers("BRIDGE_PINS"), numbers("TRACK_PINS")


@pytest.fixture(scope="module")
def elf() -> Path:
    return build_sketch(Path(GIVEN or ""))


@pytest.fixture(scope="module")
def motors(elf: Path) -> Teensy41:
    return Teensy41(elf)


@pytest.fixture
def regulators(elf: Path) -> Teensy41:
    return Teensy41(elf, pressure=True)


def test_pins_are_used_once():
    analogue = numbers("ANALOG_PINS")[0]
    used = [row[0] for row in PWM] + [pin for row in BRIDGES for pin in row] + [row[0] for row in TRACKS]
    assert (len(PWM), len(BRIDGES), len(TRACKS), len(analogue)) == (6, 4, 8, 6)
    every = [*used, *analogue, 41]
    assert len(set(every)) == len(every)
    assert 13 not in every, "the LED of the board"


def value(chip: Teensy41, channel: int) -> int:
    """Duty register of a PWM channel: VAL3 for output A, VAL5 for B."""
    _, unit, submodule, b, _ = PWM[channel]
    return chip.half(FLEXPWM[unit] + 0x60 * submodule + (0x1E if b else 0x16))


@needs_core
def test_pwm_pins_are_those_of_the_core(motors: Teensy41):
    table = motors.symbols["pwm_pin_info"]
    for pin, unit, submodule, b, alternate in PWM:
        kind, module, channel, mux = motors.uc.mem_read(table + 4 * pin, 4)
        assert (kind, module, channel, mux) == (1, (unit - 1) << 4 | submodule, 1 + b, alternate)
        base = FLEXPWM[unit] + 0x60 * submodule
        assert motors.half(base + 0x0E) + 1 == BUS_HZ // 20_000
        assert motors.half(FLEXPWM[unit] + 0x180) >> (4 if b else 8) & 1 << submodule, "the output is on"


@needs_core
def test_bridges_are_left_to_their_wiring_before_a_configuration(motors: Teensy41):
    for channel, (in_a, in_b, _) in enumerate(BRIDGES):
        for pin in (in_a, in_b, PWM[channel][0]):
            _, mux, pad, _ = motors.pin(pin)
            assert motors.output(pin) is None
            assert motors.word(mux) & 7 == 5
            assert not motors.word(pad) >> 12 & 1, "neither pull nor keeper"


@needs_core
def test_every_track_reaches_its_decoder(motors: Teensy41):
    """Outputs of the crossbar by the core's imxrt.h."""
    header = (Path(GIVEN or "") / "imxrt.h").read_text()
    for number, (pin, alternate, crossbar) in enumerate(TRACKS):
        name = f"XBARA1_OUT_ENC{number // 2 + 1}_PHASE{'AB'[number % 2]}_INPUT"
        found = re.search(rf"#define {name} (\d+)", header)
        assert found
        output = int(found[1])
        selected = motors.half(XBAR + 2 * (output // 2)) >> 8 * (output % 2) & 0xFF
        assert selected == crossbar
        assert re.search(rf"#define XBARA1_IN_IOMUX_XBAR_IN(OUT)?{crossbar:02d} {crossbar}\b", header)
        assert motors.word(motors.pin(pin)[1]) & 7 == alternate
    for base in ENCODERS:
        assert motors.half(base + 2) == 3 << 8 | 20, "filtered"


@needs_core
def test_tick_watchdog_and_analogue_channels(motors: Teensy41):
    assert motors.word(PIT_LDVAL) + 1 == 24_000, "of 24 MHz"
    assert motors.word(PIT_TCTRL) & 3 == 3
    assert motors.word(WDOG3_CS) & 1 << 7, "enabled"
    assert motors.word(WDOG3_CS) & 1 << 5 == 0, "not to be changed"
    assert 20 < motors.word(WDOG3_TOVAL) / 32.768 < 50
    table = motors.symbols["pin_to_channel"]
    channels = [motors.uc.mem_read(table + pin, 1)[0] for pin in numbers("ANALOG_PINS")[0]]
    assert channels == numbers("ADC_CHANNELS")[0]


@needs_core
@pytest.mark.parametrize(
    ("cause", "starts", "expected"),
    [(1, 0, "POWER_UP"), (1, 4, "PIN"), (WATCHDOG, 4, "WATCHDOG"), (2, 4, "SOFTWARE")],
)
def test_the_cause_of_a_reset(elf: Path, cause: int, starts: int, expected: str):
    hello = Host(Teensy41(elf, cause=cause, starts=starts).ask_usb).ask(Type.HELLO)
    assert isinstance(hello, messages.Hello)
    assert (hello.cause.name, hello.boot) == (expected, starts + 1)
    # Motors that moved before the reset have no position; only a power-up is taken as parked.
    assert hello.capabilities == (205, 205, 205, 205, 0, 0)


@needs_core
def test_the_loop_feeds_the_watchdog_only_while_ticks_run(elf: Path):
    chip = Teensy41(elf)
    chip.run_ms(20)
    fed = chip.refreshed
    assert fed >= 19
    chip.run_ms(20, ticks=False)
    assert chip.refreshed <= fed + 1
    chip.run_ms(20, loop=False)
    assert chip.refreshed <= fed + 1


def turn(chip: Teensy41, milliseconds: int) -> None:
    """The shafts turn as their bridges drive them; a count that stands under drive ends the motion."""
    for _ in range(milliseconds):
        chip.run_ms(1)
        for channel, (in_a, in_b, _) in enumerate(BRIDGES):
            base, a, b = ENCODERS[channel], chip.output(in_a), chip.output(in_b)
            count = chip.half(base + 0x0E) << 16 | chip.half(base + 0x14)
            count += round(7.6 * value(chip, channel) * 20_000 / BUS_HZ) * (bool(a) - bool(b))
            chip.set_half(base + 0x0E, count >> 16)
            chip.set_half(base + 0x14, count)


@needs_core
def test_a_motor_follows_and_stops_without_its_host(elf: Path):
    chip = Teensy41(elf)
    host = Host(chip.ask_usb)
    host.configure(motors=4)
    chip.run_ms(60)
    host.arm(motors=4)
    for _ in range(5):
        host.demand(dict.fromkeys(range(4), 4000))
        turn(chip, 10)
    assert all(value(chip, channel) > 0 for channel in range(4))
    for in_a, in_b, _ in BRIDGES:
        assert {chip.output(in_a), chip.output(in_b)} == {False, True}
    host.demand(dict.fromkeys(range(4), 4000))
    assert host.telemetry is not None
    assert all(report.position > 20 for report in host.telemetry.channels.values())
    turn(chip, 95)
    assert {chip.output(pin) for pin in BRIDGES[0][:2]} == {False, True}, "the watchdog has 100 ms"
    turn(chip, 10)
    for channel, (in_a, in_b, _) in enumerate(BRIDGES):
        assert value(chip, channel) == 0 or chip.output(in_a) == chip.output(in_b), "it brakes"


@needs_core
def test_counts_and_missed_edges_reach_the_host(elf: Path):
    chip = Teensy41(elf)
    host = Host(chip.ask_usb)
    host.configure(motors=4)
    for base, count in zip(ENCODERS, (70_000, -3, 12, 0), strict=True):
        chip.set_half(base + 0x0E, count >> 16)
        chip.set_half(base + 0x14, count)
    chip.run_ms(5)
    host.demand({})
    assert host.telemetry is not None
    assert [host.telemetry.channels[i].position for i in range(4)] == [70_000, -3, 12, 0]
    chip.both_changed.add(2)
    chip.run_ms(2)
    assert not chip.both_changed
    host.demand({})
    assert host.telemetry.channels[2].missed_edges == 1


@needs_core
def test_regulators_get_their_duty_and_read_back(regulators: Teensy41):
    for channel in numbers("ADC_CHANNELS")[0]:
        regulators.analog[channel] = 0
    host = Host(regulators.ask_usb)
    host.configure_regulators()
    regulators.run_ms(60)
    host.arm()
    for _ in range(10):
        regulators.run_ms(10)
        host.demand(dict.fromkeys(range(6), 10_000))
    assert all(value(regulators, channel) > 0 for channel in range(6))
    for pin, _, _, _, alternate in PWM:
        assert regulators.word(regulators.pin(pin)[1]) & 7 == alternate, "driven by the PWM unit"
