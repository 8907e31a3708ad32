"""Which servo is it? A mark of 12 bits in each servo, which it keeps without power.

Servos have no serial number. The mark is in Min and Max Position Limit (52, 48), which act in position mode
only (e-manual, register 11): 0 to 63, and 4095 to 4032, so that another program in that mode loses less than
6 degrees at either end. A servo with other limits has no mark. The host remembers the marks by id
(`contid.kit.remembered`); a bus with other servos is refused before anything moves.
"""

from __future__ import annotations

import logging
import random
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from typing import Final

from contid.errors import DeviceError, DeviceNotFoundError
from contid.hal import AxisOnBus
from contid.hal.pulses import ProvenDevice
from contid.kit.remembered import BusMemory, Remembered, accept_remedy
from contid.kit.serial_ports import find_port
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis
from contid_drivers.dynamixel.client import ServoClient
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions
from contid_drivers.dynamixel.port import ServoPort

log = logging.getLogger(__name__)

_BITS: Final = 6
_PART: Final = (1 << _BITS) - 1
_ALL: Final = range(1, 1 << 2 * _BITS)
_SIZE: Final = reg.MAX_POSITION.size + reg.MIN_POSITION.size


def read_mark(client: ServoClient, device: int, in_tick: bool = False) -> str:
    """The mark of a servo, three hexadecimal digits; "" without one.

    Raises:
        NoAnswerError: it is silent.
    """
    read = client.look if in_tick else client.read_block
    block = read(device, reg.MAX_POSITION.address, _SIZE)
    high = reg.MAX_POSITION.high - reg.MAX_POSITION.decode(block[:4])
    low = reg.MIN_POSITION.decode(block[4:])
    if not (0 <= high <= _PART and 0 <= low <= _PART and (high or low)):
        return ""
    return f"{low << _BITS | high:03x}"


def _write_mark(client: ServoClient, device: int, mark: str) -> None:
    value = int(mark, 16)
    client.write(device, reg.MAX_POSITION, reg.MAX_POSITION.high - (value & _PART))
    client.write(device, reg.MIN_POSITION, value >> _BITS)


def require_known(client: ServoClient, axes: Sequence[Axis], memory: BusMemory | None) -> None:
    """Refuse a bus whose servos are not those remembered; mark and remember those of a bus met first.

    Servos under torque cannot be marked; they are when the bus is opened without.

    Raises:
        DeviceNotFoundError: other servos; lists expected and found.
    """
    if memory is None:
        return
    marks = {axis.device: read_mark(client, axis.device) for axis in axes}
    remembered = memory.load() or memory.empty
    if problem := _problem(axes, marks, remembered, memory):
        raise DeviceNotFoundError(client.bus, problem, accept_remedy(client.bus))
    devices = marked(client, axes, marks, memory)
    if devices != remembered.devices:
        memory.save(replace(remembered, devices=devices))


def _problem(
    axes: Sequence[Axis], marks: Mapping[int, str], remembered: Remembered, memory: BusMemory
) -> str:
    """What is wrong with the servos found, "" for nothing."""
    lines = []
    for axis in axes:
        found, expected = marks[axis.device], remembered.devices.get(str(axis.device))
        if found == expected or (not found and expected is None):
            continue
        owner = memory.owner_of(found) if found else ""
        if expected is None and not owner:
            continue
        what = f"that with mark {found}" if found else "one without a mark (new, or reset)"
        what += f", which belongs to {owner}" if owner else ""
        before = "one that no other bus has" if expected is None else f"that with mark {expected}"
        lines.append(f"id {axis.device} ({axis.name}): expected the servo of before, {before}; found {what}")
    return "; ".join(lines)


def examined(client: ServoClient, axes: Sequence[Axis], memory: BusMemory) -> str:
    """What `require_known` would refuse, "" for nothing; writes nothing."""
    marks = {axis.device: read_mark(client, axis.device) for axis in axes}
    return _problem(axes, marks, memory.load() or memory.empty, memory)


def marked(
    client: ServoClient, axes: Sequence[Axis], marks: Mapping[int, str], memory: BusMemory
) -> dict[str, str]:
    """Mark the servos without a mark and without torque; the marks of all, by id."""
    taken = {*marks.values(), *(mark for each in memory.others() for mark in each.devices.values())}
    for axis in axes:
        axis.mark = marks[axis.device]
        if axis.mark or client.read(axis.device, reg.TORQUE_ENABLE):
            continue
        free = [mark for mark in (f"{number:03x}" for number in _ALL) if mark not in taken]
        mark = random.SystemRandom().choice(free)
        _write_mark(client, axis.device, mark)
        taken.add(mark)
        axis.mark = mark
        log.info("%s: marked %s, in registers 48 and 52", client.name(axis.device), mark)
    return {str(axis.device): axis.mark for axis in axes if axis.mark}


def is_same(client: ServoClient, axis: Axis) -> bool:
    """Whether the servo of when the bus was opened answers; for a tick, so with one try.

    Raises:
        NoAnswerError: it is silent.
    """
    return not axis.mark or read_mark(client, axis.device, in_tick=True) == axis.mark


def require_same(client: ServoClient, axis: Axis) -> None:
    """Refuse a servo that is not the one of when the bus was opened: cables can be exchanged under a run.

    Raises:
        DeviceError: another one answers.
    """
    if axis.mark and (found := read_mark(client, axis.device)) != axis.mark:
        what = f"mark {found}" if found else "no mark"
        raise DeviceError(
            client.name(axis.device),
            f"another servo answers: expected mark {axis.mark}, found {what}",
            accept_remedy(client.bus),
        )


def servo_device(client: ServoClient, axis: Axis) -> ProvenDevice:
    """The servo of an axis: its model and mark, its firmware."""
    mark = read_mark(client, axis.device)
    return ProvenDevice(f"{axis.options.model} {mark}".rstrip(), str(client.read(axis.device, reg.FIRMWARE)))


def wiring(options: DynamixelBusOptions, axis: DynamixelAxisOptions) -> Mapping[str, object]:
    """The options of an axis and its bus that a change of wiring would change."""
    return {"port": options.port} | axis.model_dump(mode="json", include={"id", "model"})


def devices(name: str, options: DynamixelBusOptions, axes: Sequence[AxisOnBus]) -> Mapping[str, ProvenDevice]:
    """The servo of each axis that answers now (`contid.hal.pulses.Proves.devices`)."""
    states = [Axis.of(axis, options) for axis in axes]
    path = find_port(name, options.port)
    with closing(ServoPort(name, path, options.baud, options.usb_latency_ms / 1e3)) as port:
        client = ServoClient(name, port)
        return {a.name: servo_device(client, a) for a in states if client.ping(a.device) is not None}
