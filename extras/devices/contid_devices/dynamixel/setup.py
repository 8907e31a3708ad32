"""``contid servo setup``: number the servos of a robot file, one after the other.

Each servo is plugged in, alone or behind those numbered already; the one that is new on the port gets the id
and the baud rate of its axis. A 2XL430 or 2XC430 is two servos with an id each and one baud rate (e-manual):
which is which shows when its shaft is turned.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from typing import Final

from contid.errors import DeviceError
from contid.hal import AxisOnBus, FoundDevice, Report
from contid.kit.remembered import BusMemory, memory_of
from contid.kit.serial_ports import find_port
from contid_devices.dynamixel import commission
from contid_devices.dynamixel.scan import OTHER_BAUDS, scan
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis
from contid_drivers.dynamixel.checks import identity
from contid_drivers.dynamixel.client import ServoClient
from contid_drivers.dynamixel.link import handshake
from contid_drivers.dynamixel.options import DynamixelBusOptions
from contid_drivers.dynamixel.port import ServoPort

#: A shaft was turned by hand; the other one of its body hardly moves.
TURNED_TICKS: Final = 200


def setup(
    name: str,
    options: DynamixelBusOptions,
    axes: Sequence[AxisOnBus],
    ask: Callable[[str], None],
    report: Report,
) -> None:
    """Ask for each servo and number it; ``ask`` shows a request and waits for the person.

    Raises:
        DeviceError: the port is missing, or a servo refuses.
    """
    numbered: set[int] = set()
    for axis in (Axis.of(each, options) for each in axes):
        request = f"Plug in the servo of {axis.name} (id {axis.device}, {axis.options.model})"
        while True:
            ask(request)
            path = find_port(name, options.port)
            fresh = _new(path, (), options.baud, numbered, report)
            if not fresh and numbered:
                # The servos that are numbered answer at the usual rates, so the others were not asked.
                fresh = _new(path, OTHER_BAUDS, options.baud, numbered, report)
            if _is_pair(fresh):
                fresh = _turned(path, fresh, axis, ask, report)
            if len(fresh) != 1:
                report(_count_problem(fresh))
            elif fresh[0].model != axis.options.model:
                report(f"it is a {fresh[0].model}; the robot file has {axis.options.model}")
            elif _number(path, fresh[0], axis, options, report):
                numbered.add(axis.device)
                break


def _is_pair(fresh: Sequence[FoundDevice]) -> bool:
    """Whether these are the two servos in the body of one 2XL430 or 2XC430."""
    return len(fresh) == 2 and fresh[0].model == fresh[1].model and fresh[0].model.startswith("2x")


def _turned(
    path: str, pair: Sequence[FoundDevice], axis: Axis, ask: Callable[[str], None], report: Report
) -> list[FoundDevice]:
    """The servo of a pair whose shaft a person turns; empty when none or both turned.

    Its id is free afterwards: the other servo gives way to the next free one.
    """
    before = [_position(path, each) for each in pair]
    ids = " and ".join(str(each.address) for each in pair)
    ask(f"It has two shafts (id {ids}): turn that of {axis.name} by a quarter turn, by hand")
    ways = [abs(_position(path, each) - at) for each, at in zip(pair, before, strict=True)]
    if max(ways) < TURNED_TICKS or min(ways) * 2 > max(ways):
        report(f"the shafts turned by {' and '.join(f'{way / reg.TICKS_PER_DEG:.0f}' for way in ways)} deg")
        return []
    chosen, other = pair if ways[0] > ways[1] else pair[::-1]
    if other.address == axis.device:
        with commission.sdk_bus(path, other.baud) as bus:
            free = next(each for each in range(reg.ID.high, 0, -1) if not bus.answers(each))
        commission.set_id(path, other.baud, int(other.address), free)
    return [chosen]


def _position(path: str, found: FoundDevice) -> int:
    with commission.sdk_bus(path, found.baud) as bus:
        return bus.read(int(found.address), reg.PRESENT_POSITION)


def accept(name: str, options: DynamixelBusOptions, axes: Sequence[AxisOnBus], report: Report) -> None:
    """Take the servos that answer as those of the bus (`contid.hal.Identifies.accept`)."""
    states = [Axis.of(axis, options) for axis in axes]
    path = find_port(name, options.port)
    memory = memory_of(name, options.port, path, axes)
    if memory is None:
        report(f"{name}: emulated devices are not remembered")
        return
    with closing(ServoPort(name, path, options.baud, options.usb_latency_ms / 1e3)) as port:
        client = ServoClient(name, port, {axis.device: axis.name for axis in states})
        handshake(client, states, options)
        for line in _accept(client, states, memory):
            report(line)


def _new(
    path: str, bauds: Sequence[int], numbered_baud: int, numbered: set[int], report: Report
) -> list[FoundDevice]:
    """Servos on the port that are not numbered yet."""
    present = scan([path], bauds, report)
    return [each for each in present if each.baud != numbered_baud or each.address not in numbered]


def _number(path: str, found: FoundDevice, axis: Axis, options: DynamixelBusOptions, report: Report) -> bool:
    """Set id and baud rate of the new servo; False when it refuses, with the reason reported."""
    try:
        if found.address != axis.device:
            commission.set_id(path, found.baud, int(found.address), axis.device)
        if found.baud != options.baud:
            commission.set_baud(path, found.baud, axis.device, options.baud)
    except DeviceError as error:
        report(str(error))
        return False
    report(f"{axis.name} is id {axis.device} at {options.baud} baud")
    return True


def _count_problem(fresh: Sequence[FoundDevice]) -> str:
    if not fresh:
        return "no new servo answers: check its plug and supply; a servo with an id in use must be alone"
    ids = ", ".join(f"id {each.address} at {each.baud} baud" for each in fresh)
    return f"{len(fresh)} new servos answer ({ids}): plug in one at a time"


def _accept(client: ServoClient, axes: Sequence[Axis], memory: BusMemory) -> list[str]:
    """Take the servos that answer as those of the bus; returns a line for each.

    Raises:
        DeviceError: one is silent, or under torque without a mark.
    """
    marks = {axis.device: identity.read_mark(client, axis.device) for axis in axes}
    for axis in axes:
        if not marks[axis.device] and client.read(axis.device, reg.TORQUE_ENABLE):
            raise DeviceError(client.name(axis.device), "torque is on and locks its mark", "relax it first")
    doubled = {mark for mark in marks.values() if mark and [*marks.values()].count(mark) > 1}
    for axis in axes:
        if marks[axis.device] in doubled:
            marks[axis.device] = ""
    memory.save(replace(memory.empty, devices=identity.marked(client, axes, marks, memory)))
    return [f"{client.name(axis.device)}: mark {axis.mark}" for axis in axes]
