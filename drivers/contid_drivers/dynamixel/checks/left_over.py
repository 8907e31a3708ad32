"""Settings that other programs leave in servos and that contid does not write: read, compared, named."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final, NamedTuple

from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.client import ServoClient, ServoError
from contid_drivers.dynamixel.registers import Register

#: Errors after which every new servo drops its torque, and temperature limits of the models.
SHUTDOWN: Final = 0x34
TEMPERATURES_C: Final = (65, 80)
_FIRST: Final = reg.TEMPERATURE_LIMIT.address


class LeftOver(NamedTuple):
    """A setting that another program has changed, and what to do."""

    message: str
    remedy: str


def changed_limits(client: ServoClient, device: int) -> list[LeftOver]:
    """Limits of a servo that differ from those of a new one.

    Raises:
        NoAnswerError: it is silent.
    """
    block = client.read_block(device, _FIRST, reg.SHUTDOWN.address + reg.SHUTDOWN.size - _FIRST)

    def value(register: Register) -> int:
        begin = register.address - _FIRST
        return register.decode(block[begin : begin + register.size])

    found = []
    if missing := SHUTDOWN & ~value(reg.SHUTDOWN):
        what = f"shutdown (63) leaves the torque on after: {reg.describe_hardware_error(missing)}"
        found.append(LeftOver(what, f"`contid servo write {device} shutdown {SHUTDOWN}`"))
    if (pwm := value(reg.PWM_LIMIT)) < reg.PWM_LIMIT.default:
        what = f"pwm limit (36) is {pwm} of {reg.PWM_LIMIT.default}: it is weak and slow"
        found.append(LeftOver(what, f"`contid servo write {device} pwm_limit {reg.PWM_LIMIT.default}`"))
    if not TEMPERATURES_C[0] <= (hot := value(reg.TEMPERATURE_LIMIT)) <= TEMPERATURES_C[1]:
        what = f"temperature limit (31) is {hot} deg C"
        remedy = f"`contid servo write {device} temperature_limit {TEMPERATURES_C[0]}`, or that of its manual"
        found.append(LeftOver(what, remedy))
    return found


def followers(client: ServoClient, others: Collection[int], configured: Collection[int]) -> list[LeftOver]:
    """Servos beside those of the robot file that move with one of them, by their Secondary ID (12)."""
    found = []
    for device in sorted(others):
        try:
            second = client.read(device, reg.SECONDARY_ID)
        except ServoError:
            continue
        if second in configured:
            what = f"id {device} has the secondary id (12) {second}: it moves with servo {second}"
            remedy = (
                f"`contid servo write {device} secondary_id {reg.SECONDARY_ID.default}`, or disconnect it"
            )
            found.append(LeftOver(what, remedy))
    return found
