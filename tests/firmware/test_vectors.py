"""The shared vectors: Python's codec, the core on this computer, the core on Cortex-M3 and M7."""

from __future__ import annotations

import subprocess

import pytest
from unicorn import arm_const

from contid_devices.due.cortex import build_core
from contid_devices.due.firmware_build import WARNINGS, build_host, firmware_dir
from contid_drivers.due import frames, messages
from contid_drivers.due.codes import Refusal, Type
from tests.firmware.cortex_m import CoreBoard
from tests.firmware.elf import read_elf

pytestmark = pytest.mark.process

SANITIZE = [*WARNINGS, "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g"]


def lines() -> list[list[str]]:
    text = (firmware_dir() / "vectors" / "vectors.txt").read_text()
    return [line.split() for line in text.splitlines()]


def test_python_codec():
    checked = 0
    for item, *rest in lines():
        if item == "frame":
            payload, wire = map(bytes.fromhex, rest)
            assert frames.seal(payload) == wire
            assert frames.unseal(wire[:-1]) == payload
            checked += 1
        elif item == "noise":
            assert frames.unseal(bytes.fromhex(rest[0])) is None
            checked += 1
        elif item == "<" and rest:
            messages.read_answer(bytes.fromhex(rest[0]))
            checked += 1
    assert checked > 100


def test_every_message_and_refusal_is_in_the_vectors():
    answers = [
        messages.read_answer(bytes.fromhex(rest[0]))[1] for item, *rest in lines() if item == "<" and rest
    ]
    refusals = {Refusal(one.refusal) for one in answers if isinstance(one, messages.Refused)}
    # The vectors have one port and a good sensor.
    assert refusals == set(Refusal) - {Refusal.NO_SENSOR, Refusal.OTHER_PORT}
    requests = {bytes.fromhex(rest[0])[1] for item, *rest in lines() if item == ">" and len(rest[0]) > 4}
    assert requests >= {kind for kind in Type if kind < 0x80}
    assert {type(one) for one in answers} == {
        messages.Hello, messages.Configured, messages.Telemetry, messages.Refused, messages.PulseTrace,
    }  # fmt: skip


def test_core_on_this_computer():
    program = build_host(SANITIZE, "vectors.cpp")
    path = firmware_dir() / "vectors" / "vectors.txt"
    done = subprocess.run([str(program), str(path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("processor", "model"),
    [("cortex_m3", arm_const.UC_CPU_ARM_CORTEX_M3), ("cortex_m7", arm_const.UC_CPU_ARM_CORTEX_M7)],
)
def test_core_on_the_processors_of_the_boards(processor: str, model: int):
    board = CoreBoard(read_elf(build_core(processor)), model)
    answer: bytes | None = None
    checked = 0
    for number, (item, *rest) in enumerate(lines(), 1):
        if item == "board":
            board.start(rest[0])
        elif item == "tick":
            for _ in range(int(rest[0])):
                board.tick()
        elif item == "count":
            board.set_count(int(rest[0]), int(rest[1]))
        elif item == "analog":
            board.set_analog(int(rest[0]), int(rest[1]))
        elif item == ">":
            wire = board.wire(frames.seal(bytes.fromhex(rest[0])))
            answer = frames.unseal(wire[:-1]) if wire else b""
        elif item == "<":
            expected = bytes.fromhex(rest[0]) if rest else b""
            assert answer == expected, f"vectors.txt:{number}"
            checked += 1
    assert checked > 80


@pytest.mark.parametrize("standard", ["-std=gnu++11"])
def test_core_compiles_as_the_arduino_ide_compiles_it(standard, tmp_path):
    flags = [
        standard,
        "-Wall",
        "-Wextra",
        "-Werror",
        "-Wconversion",
        "-Wshadow",
        "-fno-exceptions",
        "-fno-rtti",
    ]
    for source in sorted((firmware_dir() / "contid_due" / "src" / "core").rglob("*.cpp")):
        subprocess.run(["g++", *flags, "-c", "-o", str(tmp_path / "x.o"), str(source)], check=True)
