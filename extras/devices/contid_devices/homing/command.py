"""``contid home``: find the zero of axes and write it into the robot file."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from contid.cli.support.parameters import NUMBER, robot_names
from contid.errors import ContidError
from contid.hal import AxisOnBus, Homed, Homes, Parks, Reference
from contid.hal.homing import REPEAT_TENDON_M
from contid.robot_file.base import AxisDescription
from contid.robot_file.load import LoadedFile, load_robot_file
from contid.units import DEG, MM_PER_M, mm_to_m
from contid_devices.homing.moving_commands import interruptible, require_axes, require_writable

if TYPE_CHECKING:
    from contid.control.engine.wiring import WiredBus


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@click.argument("axes", nargs=-1)
@click.option("--dry-run", is_flag=True, help="Home, print, write nothing.")
@click.option("--force", is_flag=True, help="Take zeros that moved: the robot was rebuilt.")
@click.option(
    "--parked", is_flag=True, help="AXES without homing stand in their parked pose now; move nothing."
)
@click.option("--here", is_flag=True, help="AXES were brought to a known place by hand; turn no motor.")
@click.option("--at-mm", type=NUMBER, default=0.0, help="Length at that place; 0 where left out.")
def command(
    robot_file: str, axes: tuple[str, ...], dry_run: bool, force: bool, parked: bool, here: bool, at_mm: float
) -> None:
    """Home AXES (ROBOT.AXIS; default: all with `homing:`) one by one and write their zero into ROBOT_FILE.

    Each reference is searched twice, with a way back between. One that repeats to more than 1 degree (2 mm of
    a tendon), or that is that far from the file's zero, is an error; --force gives the file's zero up.
    Shipped files are not written: by the name of one, --dry-run and --parked only. Each zero is written, in
    one step, as soon as it is found: an error or an interrupt at a later axis keeps it. Ctrl-C, SIGTERM, and
    `contid estop`, `stop` or `hold` from another terminal take the torque off at once.

    With --parked, AXES (default: all without homing) count from their parked pose again, after a restart of
    their board lost it. Look at the robot first: contid moves as if it stood there.

    With --here, an axis without homing has the length --at-mm now: `contid home ROBOT.yaml arm.left --here
    --at-mm 30`. It is to be turned away by hand and back, which shows that its encoder counts.
    """
    from contid.control.engine.wiring import wired_buses
    from contid.robot_file.load import find_robot_file
    from contid_devices.homing.stop_server import StopServer

    if parked and (here or force or dry_run or at_mm):
        raise click.UsageError("--parked goes alone: it moves nothing, and the board takes the pose at once")
    path = find_robot_file(robot_file)
    loaded = load_robot_file(path)
    buses = wired_buses(loaded)
    require_axes(buses, axes)
    if parked:
        _park(path, buses, axes)
        return
    if not dry_run:
        require_writable(path, "home")
    if here:
        for name in axes:
            _keep(loaded, path, _here(loaded, buses, name, at_mm, force), dry_run)
        if not axes:
            raise ContidError("--here needs the axes that stand in their place: ROBOT.AXIS")
        return
    if at_mm:
        raise ContidError("--at-mm goes with --here; homing has its own `at_mm` in the robot file")
    homed = 0
    with interruptible(), StopServer(robot_file, "homing"):
        for found in _home(loaded, buses, axes, force):
            _keep(loaded, path, found, dry_run)
            homed += 1
    if not homed:
        raise ContidError(f"{robot_file}: no axis has `homing:` (docs/devices/dynamixel.md, Zero and turns)")
    if not dry_run:
        load_robot_file(path)


def _here(loaded: LoadedFile, buses: Sequence[WiredBus], name: str, at_mm: float, force: bool) -> Homed:
    """The reference of an axis that a person has brought there."""
    from contid_devices.homing import zero_here

    bus = next(each for each in buses if any(axis.name == name for axis in each.axes))
    options = next(axis.options for axis in bus.axes if axis.name == name)
    zero_here.require_place(
        _described(loaded, name).mm_per_rev, getattr(options, "homing", None), name, at_mm
    )
    reference = reference_of(loaded, name, at_mm)
    if force:
        reference = replace(reference, zero_rad=None)

    def ask(request: str) -> None:
        click.prompt(f"{request}, then press Enter", default="", show_default=False, prompt_suffix=" ")

    with zero_here.reading([bus]) as read:
        return Homed(name, zero_here.here(name, reference, read, ask), at_mm, "by hand, looked at twice")


def _keep(loaded: LoadedFile, path: Path, found: Homed, dry_run: bool) -> None:
    """Print the zero of one axis and write it into the robot file."""
    from contid.robot_file.edit import Change, set_values

    zero_deg = zero_of(loaded, found)
    robot, axis = found.axis.split(".", 1)
    former = reference_of(loaded, found.axis, found.at_mm)
    zeros = former.written(zero_deg * DEG)
    if former.zero_rad is not None:
        zeros = f"old {former.written(former.zero_rad)}, new {zeros}"
    note = f"homed {datetime.now().astimezone():%Y-%m-%d %H:%M}: {found.how}"
    if not dry_run:
        set_values(path, [Change(f"robots.{robot}.axes.{axis}.zero_deg", round(zero_deg, 4), note)])
    click.echo(f"{found.axis}: zero_deg {zero_deg:.4f} ({found.how}; {zeros})")


def _park(robot_file: Path, buses: Sequence[WiredBus], axes: Sequence[str]) -> None:
    parked = 0
    for bus in buses:
        parks = bus.tool(Parks)  # type: ignore[type-abstract]  # a runtime protocol
        only = [
            axis.name
            for axis in bus.axes
            if (axis.name in axes if axes else parks is not None and parks.parkable(axis.options))
        ]
        if only:
            driver = bus.capable(Parks, "home --parked")  # type: ignore[type-abstract]  # a runtime protocol
            driver.park(bus.wiring.name, bus.wiring.options, bus.axes, only, click.echo)
            parked += len(only)
    if not parked:
        raise ContidError(f"{robot_file}: every axis finds its position by itself; nothing to park")


def _home(loaded: LoadedFile, buses: Sequence[WiredBus], axes: Sequence[str], force: bool) -> Iterator[Homed]:
    """Home one axis after the other, the tendons of a bus together; buses are checked before one moves."""
    report = functools.partial(click.echo, err=True)
    chosen: list[tuple[bool, WiredBus, Homes, list[str]]] = []
    for bus in buses:
        homing = {axis.name: getattr(axis.options, "homing", None) for axis in bus.axes}
        only = [name for name, how in homing.items() if (name in axes if axes else how is not None)]
        if only:
            homes = bus.capable(Homes, "home")  # type: ignore[type-abstract]  # a runtime protocol
            tendons = [name for name in only if getattr(homing[name], "together", False)]
            alone = [name for name in only if name not in tendons]
            chosen += [(homing[name] is not None, bus, homes, [name]) for name in alone]
            if tendons:
                chosen.append((True, bus, homes, tendons))
    # Axes without homing come first: their driver refuses them before anything moves.
    for _, bus, homes, names in sorted(chosen, key=lambda each: each[0]):
        with_zeros = [_with_reference(loaded, axis, force) for axis in bus.axes]
        yield from homes.home(bus.wiring.name, bus.wiring.options, with_zeros, names, report)


def _with_reference(loaded: LoadedFile, axis: AxisOnBus, force: bool) -> AxisOnBus:
    homing = getattr(axis.options, "homing", None)
    reference = reference_of(loaded, axis.name, getattr(homing, "at_mm", 0.0))
    if getattr(homing, "together", False) and reference.mm_per_rad is not None:
        tolerance = REPEAT_TENDON_M * MM_PER_M / abs(reference.mm_per_rad)
        reference = replace(reference, repeat_rad=tolerance)
    return replace(axis, reference=replace(reference, zero_rad=None) if force else reference)


def zero_of(loaded: LoadedFile, found: Homed) -> float:
    """``zero_deg`` with which the transmission maps the device value at the reference to ``at_mm``."""
    return math.degrees(found.value - _way_rad(_described(loaded, found.axis), found.at_mm))


def reference_of(loaded: LoadedFile, name: str, at_mm: float) -> Reference:
    """The reference of an axis by the robot file, at a length of the actuator."""
    axis = _described(loaded, name)
    zero_rad = axis.zero_deg * DEG if "zero_deg" in axis.model_fields_set else None
    mm_per_rad = None if axis.mm_per_rev is None else axis.direction * axis.mm_per_rev / math.tau
    return Reference(zero_rad, _way_rad(axis, at_mm), mm_per_rad=mm_per_rad)


def _described(loaded: LoadedFile, name: str) -> AxisDescription:
    robot, axis = name.split(".", 1)
    return loaded.file.robots[robot].axes[axis]


def _way_rad(axis: AxisDescription, at_mm: float) -> float:
    """By how much the device turns from length 0 to ``at_mm`` [rad]; 0 for an axis without a length."""
    from contid.control.tick.transmission import axis_map

    if axis.mm_per_rev is None:
        return 0.0
    to_device, _ = axis_map(axis.model_copy(update={"zero_deg": 0.0}))
    return to_device(mm_to_m(at_mm))
