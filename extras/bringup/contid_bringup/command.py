"""``contid bringup``: prove the wiring of every axis with bounded energy, and write down what was found."""

from __future__ import annotations

import functools
import math
import queue
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from contid.cli.support.parameters import robot_names
from contid.errors import DeviceError

if TYPE_CHECKING:
    from contid.control.engine.wiring import WiredBus
    from contid.hal.pulses import ProvenDevice
    from contid.robot_file.load import LoadedFile
    from contid_bringup.drive_fit import DriveFit
    from contid_bringup.motor import ByHand, MotorResult
    from contid_bringup.record import ProvenAxis
    from contid_bringup.regulator import ByEye, RegulatorResult
    from contid_bringup.wiring_faults import WiringFault
    from contid_devices.pulsed_motors import DriveFacts


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@click.argument("axes", nargs=-1)
@click.option("--yes", is_flag=True, help="Ask nothing; steps by hand are left out. For emulators.")
@click.option("--dry-run", is_flag=True, help="Examine and print; write nothing.")
@click.option(
    "--page", type=click.Path(dir_okay=False), help="Where to write the record; default: FILE-bringup.html."
)
def command(robot_file: str, axes: tuple[str, ...], yes: bool, dry_run: bool, page: str | None) -> None:
    """Prove motors, encoders, bridges and servos of AXES (ROBOT.AXIS; default: all) before a loop closes.

    Motors on boards and Dynamixel servos get single pulses of at most 30 ms and 20 % of duty, which the
    device itself bounds, one axis after the other: enough to name swapped or open wires. A proven one is
    then measured.

    The results are written into `bringup:` of ROBOT_FILE, and into a page to print; an error or an interrupt
    at a later axis keeps those of the axes before. Exit code 4 when
    something is wrong, 0 only when every axis named or examined is proven.
    """
    from contid.control.engine.wiring import wired_buses
    from contid.errors import ContidError
    from contid.robot_file.load import find_robot_file, load_robot_file
    from contid_devices.homing.moving_commands import interruptible, require_axes, require_writable
    from contid_devices.homing.stop_server import StopServer

    path = find_robot_file(robot_file)
    loaded = load_robot_file(path)
    buses = wired_buses(loaded)
    require_axes(buses, axes)
    if not dry_run:
        require_writable(path, "bring up")
    chosen = [(bus, found) for bus in buses if (found := _provable(bus, axes))]
    if not chosen:
        raise ContidError(f"{path}: no axis was examined: no driver of this file can be brought up")
    if not yes and not sys.stdin.isatty():
        raise click.UsageError("it asks before it moves, and stdin is no terminal; --yes asks nothing")
    if not yes:
        click.confirm(
            "One after the other, each motor will turn by a few degrees, each regulator get a fifth of its "
            "pressure. Is everybody clear of the robot, and the supply within reach?",
            abort=True,
        )
    by_hand = None if yes else Person()
    records: list[ProvenAxis] = []
    try:
        with interruptible(), StopServer(robot_file, "bring-up"):
            for bus, found in chosen:
                if motors := {axis: facts for axis, facts in found.items() if facts is not None}:
                    for record in _bring_up(loaded, bus, motors, by_hand):
                        records.append(record)
                if regulators := [axis for axis, facts in found.items() if facts is None]:
                    for record in _bring_up_regulators(bus, regulators, by_hand):
                        records.append(record)
    finally:
        # An error or an interrupt at a later axis keeps what was found.
        if records and not dry_run:
            _write(path, loaded, records, page)
    wrong = [record.axis for record in records if record.name != "ok"]
    wrong += [axis for axis in axes if axis not in {record.axis for record in records}]
    if wrong:
        click.echo(f"not proven: {', '.join(wrong)}", err=True)
        sys.exit(4)
    click.echo(f"proven: {', '.join(record.axis for record in records)}", err=True)


def _write(path: Path, loaded: LoadedFile, records: Sequence[ProvenAxis], page: str | None) -> None:
    """Write what was found into the robot file and into the page."""
    from contid_bringup.record import write_page, write_section

    when = datetime.now().astimezone()
    write_section(path, records, when)
    written = Path(page) if page else path.with_name(f"{path.stem}-bringup.html")
    write_page(written, path, loaded, records, when)
    click.echo(f"written: bringup: in {path}; {written}", err=True)


class Person:
    """Asks the person at the terminal (`contid_bringup.motor.ByHand`, `contid_bringup.regulator.ByEye`)."""

    def gauge_bar(self, axis: str, hold: Callable[[], object]) -> float | None:
        """What a gauge shows; "" for none."""
        text = _answered(
            f"{axis}: the highest that a gauge at its chamber shows [bar]? Enter: there is none", hold
        )
        try:
            bar = float(text.replace(",", ".")) if text else None
        except ValueError:
            bar = math.nan
        if bar is None or (math.isfinite(bar) and bar >= 0.0):
            return bar
        click.echo(f"{text!r} is no pressure in bar")
        return self.gauge_bar(axis, hold)

    def dumped(self, axis: str, hold: Callable[[], object]) -> bool:
        """Ask for the dump valve; "" when it was opened."""
        request = (
            "open the dump valve (its switch, not the supply of the board), wait 5 s, then Enter; s: skip"
        )
        return not _answered(f"{axis}: {request}", hold)

    def turned(self, axis: str) -> bool:
        """Ask for one turn; "" is yes."""
        prompt = f"{axis}: turn its output shaft by one whole turn by hand, then Enter (s: skip)"
        answer: str = click.prompt(prompt, default="", show_default=False)
        return not answer.strip()

    def saw(self, axis: str, wiggle: Callable[[], None]) -> WiringFault:
        """Wiggle it until the person has seen which part turned, and which way first."""
        from contid_bringup.wiring_faults import WiringFault

        answers = {"y": WiringFault.NONE, "o": WiringFault.OTHER_TURNED, "w": WiringFault.WRONG_SENSE}
        while True:
            click.echo(
                f"{axis}: look at it; it turns by a degree or so, first so that its value rises, and back"
            )
            wiggle()
            answer: str = click.prompt(
                "y: it did; o: another part turned; w: it began the wrong way; a: again",
                type=click.Choice([*answers, "a"]),
            )
            if answer in answers:
                return answers[answer]


def _answered(prompt: str, hold: Callable[[], object]) -> str:
    """The answer of a person; the command is held meanwhile: a watchdog does not wait."""
    answers: queue.Queue[str] = queue.Queue()
    click.echo(prompt)
    threading.Thread(target=lambda: answers.put(sys.stdin.readline()), daemon=True).start()
    while answers.empty():
        hold()
    line = answers.get()
    if not line:  # the end of stdin is no answer
        raise click.Abort from EOFError()
    return line.strip()


def _provable(bus: WiredBus, axes: tuple[str, ...]) -> Mapping[str, DriveFacts | None]:
    """What of a bus among ``axes`` (empty: all) can be brought up; None for regulators."""
    from contid_devices.pulsed_motors import Pulses

    only = [axis for axis in bus.axes if not axes or axis.name in axes]
    if not only:
        return {}
    tool = bus.tool(Pulses)  # type: ignore[type-abstract]  # a runtime protocol
    if tool is None:
        name, driver = bus.wiring.name, bus.wiring.driver
        left_out = ", ".join(axis.name for axis in only)
        click.echo(f"{name}: driver {driver!r} cannot be brought up; {left_out} not examined")
        return {}
    return {axis.name: tool.drive_facts(axis.options) for axis in only}


def _bring_up_regulators(
    bus: WiredBus, regulators: Sequence[str], by_eye: ByEye | None
) -> Iterator[ProvenAxis]:
    from contid.hal import Rest
    from contid.hal.pulses import Proves
    from contid_bringup.regulator import bring_up_regulator
    from contid_driverkit.clock import MonotonicClock
    from contid_driverkit.signals import defer_signals

    name, options, clock = bus.wiring.name, bus.wiring.options, MonotonicClock()
    report = functools.partial(click.echo, err=True)
    assert isinstance(bus.driver, Proves)
    devices = bus.driver.devices(name, options, bus.axes)
    most_pa = {axis.name: axis.travel[1] for axis in bus.axes if axis.travel is not None}
    with closing(bus.driver.open_bus(name, options, bus.axes, clock)) as opened:
        opened.open()
        try:
            for axis in opened.axes:
                with suppress(DeviceError):  # a fault that persists shows in the readings
                    opened.clear_fault([axis])
            opened.disable(opened.axes, Rest.VENT)
            for axis in regulators:
                others = [each for each in opened.axes if each != axis]
                result = bring_up_regulator(opened, axis, others, most_pa[axis], clock, report, by_eye=by_eye)
                yield _printed(bus, axis, result, devices[axis])
        finally:
            with defer_signals():
                opened.disable(opened.axes, Rest.VENT)


def _bring_up(
    loaded: LoadedFile, bus: WiredBus, motors: Mapping[str, DriveFacts], by_hand: ByHand | None
) -> Iterator[ProvenAxis]:
    from contid_bringup.motor import bring_up_motor
    from contid_devices.pulsed_motors import Pulses

    tool = bus.capable(Pulses, "bringup")  # type: ignore[type-abstract]  # a runtime protocol
    report = functools.partial(click.echo, err=True)
    with tool.pulsed_bus(bus.wiring.name, bus.wiring.options, bus.axes) as pulsed:
        for axis, facts in motors.items():
            robot, _, own = axis.partition(".")
            sense = loaded.driven[robot].axes[own].direction
            result = bring_up_motor(pulsed, axis, facts, report, by_hand, sense)
            yield _printed(bus, axis, result, pulsed.device(axis), result.fit)


def _printed(
    bus: WiredBus,
    axis: str,
    result: MotorResult | RegulatorResult,
    device: ProvenDevice,
    fit: DriveFit | None = None,
) -> ProvenAxis:
    """Print the findings about one axis; they are kept with the wiring that was examined."""
    from contid.robot_file.proven.bringup import wiring_digest
    from contid_bringup.record import ProvenAxis

    lines = result.lines()
    for line in lines:
        click.echo(f"{axis}: {line}")
    return ProvenAxis(axis, result.name, device, wiring_digest(bus.wiring, axis), lines, fit)
