"""``contid servo blink|read|write|reset``: one servo on the bench, registers by name.

None of them moves a servo: goals and torque on are refused, because a servo starts towards an old goal;
`contid run` arms it without a jump.
"""

from __future__ import annotations

import difflib
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from contid.errors import DeviceError
from contid.hal import RegisterValue
from contid_devices.dynamixel.commission import SdkBus, check_free, sdk_bus
from contid_drivers.dynamixel import duplicates
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.models import BY_NUMBER, model_name
from contid_drivers.dynamixel.registers import Register

BLINK_S: Final = 0.25
#: Writes that have a command of their own, or move the servo.
REFUSED: Final[dict[str, str]] = {
    reg.ID.name: "use `contid servo set-id`, which refuses two servos of one id",
    reg.BAUD.name: "use `contid servo set-baud`",
    **dict.fromkeys(
        (goal.name for goal in (reg.GOAL_PWM, reg.GOAL_CURRENT, reg.GOAL_VELOCITY, reg.GOAL_POSITION)),
        "a goal moves the servo without limits: use `contid run` and `contid move`",
    ),
}


def blink(path: str, baud: int, device: int, times: int) -> None:
    """Switch the LED on and off, then leave it as it was.

    Raises:
        DeviceError: the servo is silent.
    """
    with sdk_bus(path, baud) as bus:
        before = bus.read(device, reg.LED)
        try:
            for _ in range(times):
                for state in (1, 0):
                    bus.write(device, reg.LED, state)
                    time.sleep(BLINK_S)
        finally:
            bus.write(device, reg.LED, before)


def read(path: str, baud: int, device: int, names: Sequence[str]) -> list[RegisterValue]:
    """Values of registers; of all but the indirect ones without ``names``.

    Raises:
        DeviceError: the servo is silent, or has no such register.
    """
    with sdk_bus(path, baud) as bus:
        table = _table(bus, device)
        chosen = [_named(bus, device, table, name) for name in names]
        if not names:
            chosen = [each for each in table.values() if not each.name.startswith("indirect")]
        return [RegisterValue(each.name, each.address, bus.read(device, each), each.unit) for each in chosen]


def write(path: str, baud: int, device: int, name: str, value: int) -> int:
    """Set a register; returns what it holds afterwards.

    Raises:
        DeviceError: no such register, beyond its range, not writable, locked by torque, or refused.
    """
    with sdk_bus(path, baud) as bus:
        register = _named(bus, device, _table(bus, device), name)
        where = bus.name(device)
        if why := REFUSED.get(register.name):
            raise DeviceError(where, f"{register.name} is not written here", why)
        if register is reg.TORQUE_ENABLE and value:
            raise DeviceError(where, "torque on would start an old goal", "use `contid run`")
        if register is reg.STATUS_RETURN_LEVEL and value != register.default:
            raise DeviceError(where, "below 2 it does not answer reads or writes", "leave it at 2")
        if not register.writable:
            raise DeviceError(where, f"{register.name} is read-only")
        low = 0 if register is reg.BUS_WATCHDOG else register.low
        if not low <= value <= register.high:
            raise DeviceError(where, f"{register.name}: {value}; allowed {low} to {register.high}")
        if duplicates.count_answers(bus.port, device).duplicated:
            raise DeviceError(where, f"nothing written, because {duplicates.CAUSE}", duplicates.REMEDY)
        if register.eeprom and bus.read(device, reg.TORQUE_ENABLE):
            raise DeviceError(where, f"torque is on and locks {register.name}", "relax it first")
        bus.write(device, register, value)
        return bus.read(device, register)


def reset(path: str, baud: int, device: int) -> None:
    """Give every setting its factory value but id and baud rate.

    Raises:
        DeviceError: it is silent or under torque, or two servos have its id.
    """
    with sdk_bus(path, baud) as bus:
        check_free(bus, device, baud)
        bus.factory_reset(device)


def _table(bus: SdkBus, device: int) -> dict[str, Register]:
    """Registers of the servo's own model, with the units of its currents, by name."""
    number, firmware = bus.read(device, reg.MODEL_NUMBER), bus.read(device, reg.FIRMWARE)
    model = BY_NUMBER.get(number)
    if model is None:
        raise DeviceError(bus.name(device), f"{model_name(number)}: its registers are not known to contid")
    table = reg.table_of(model.indirect_data(firmware), model.current_limit, model.gains)
    unit = "0.1 %" if model.ma_per_unit is None else f"{model.ma_per_unit:g} mA"
    return {each.name: replace(each, unit=unit) if each.unit == "mA" else each for each in table}


def _named(bus: SdkBus, device: int, table: dict[str, Register], name: str) -> Register:
    """A register by its name, with spaces, ``_`` or ``-``, or by its address."""
    plain = name.lower().replace("_", " ").replace("-", " ")
    for register in table.values():
        if plain in (register.name.replace("-", " "), str(register.address)):
            return register
    near = difflib.get_close_matches(plain, table, 3)
    remedy = f"did you mean {', '.join(near)}?" if near else "`contid servo read` lists them"
    raise DeviceError(bus.name(device), f"no register {name!r}", remedy)
