"""Rules of the e-manual that the emulated servo follows."""

from __future__ import annotations

import math

import pytest

from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.packets import Instruction, StatusError, build, take
from contid_emulate.dynamixel import Servo
from contid_emulate.dynamixel.motion import ShaftMotion
from contid_emulate.dynamixel.replies import answers


def errors(servo: Servo, instruction: int, parameters: bytes = b"") -> list[int]:
    packet = take(bytearray(build(servo.device, instruction, parameters)))
    assert packet is not None
    replies = []
    for reply in answers(packet, [servo], 1e-5):
        status = take(bytearray(reply.wire))
        assert status is not None
        replies.append(status.error)
    return replies


def test_an_action_without_a_registered_write_is_an_instruction_error() -> None:
    servo = Servo(1)
    assert errors(servo, Instruction.ACTION) == [StatusError.INSTRUCTION]
    assert errors(servo, Instruction.REG_WRITE, b"\x41\x00\x01") == [StatusError.NONE]
    assert errors(servo, Instruction.ACTION) == [StatusError.NONE]
    assert errors(servo, Instruction.ACTION) == [StatusError.INSTRUCTION]
    assert servo.memory[65] == 1


@pytest.mark.parametrize("sign", [1, -1])
def test_a_goal_beyond_256_turns_less_a_tick_is_refused(sign: int) -> None:
    servo = Servo(1)
    servo.put(reg.OPERATING_MODE, 4)
    at = reg.GOAL_POSITION.address.to_bytes(2, "little")
    last, beyond = sign * 1_048_575, sign * 1_048_576
    assert errors(servo, Instruction.WRITE, at + reg.GOAL_POSITION.encode(last)) == [StatusError.NONE]
    assert errors(servo, Instruction.WRITE, at + reg.GOAL_POSITION.encode(beyond)) == [StatusError.DATA_RANGE]
    assert servo.get(reg.GOAL_POSITION) == last


@pytest.mark.parametrize("offset", [0, 100, -100])
def test_a_watchdog_that_trips_moves_a_servo_by_its_homing_offset(offset: int) -> None:
    """DynamixelSDK issue 584: the goal becomes another position than the present one."""
    servo = Servo(1, position_ticks=2048.0)
    servo.put(reg.OPERATING_MODE, reg.MODE_NUMBERS["extended_position"])
    servo.put(reg.HOMING_OFFSET, offset)
    servo.put(reg.TORQUE_ENABLE, 1)
    servo.put(reg.BUS_WATCHDOG, 1)
    servo.advance(1.0)
    assert servo.tripped
    assert servo.tripped_goal == 2048.0 + offset
    assert servo.position_ticks == 2048.0 + offset


def test_a_slow_servo_is_slow_under_a_pwm_as_well() -> None:
    sound, slow = (ShaftMotion(0.0, (-math.inf, math.inf)) for _ in range(2))
    slow.slowed = 0.1
    for shaft in (sound, slow):
        shaft.drive(1.0, 1.0, 1.0)
    assert slow.velocity == pytest.approx(0.1 * sound.velocity)
