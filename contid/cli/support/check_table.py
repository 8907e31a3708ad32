"""The report of ``contid check`` as tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from rich.console import Console
from rich.table import Table
from rich.text import Text

from contid.robot_file.summary import ChainReport, FileReport, RobotReport

#: Labels of the kinds of target; others are printed by their names.
_KINDS: Final = {
    "x_axis": "x axis of the tip",
    "mid": "mid-point",
    "actuation": "or actuation",
    "extra": "further axes",
    "measured": "measured tip",
    "measured_direction": "measured direction",
}


def print_report(report: FileReport, columns: Mapping[str, Mapping[str, Sequence[str]]]) -> None:
    """Print robots, axes, buses, limits, rate and placeholders.

    Args:
        report: summary of the robot file.
        columns: column names of trajectories, by robot and kind of target.
    """
    console = Console(highlight=False)

    def echo(line: str) -> None:
        console.print(line, soft_wrap=True, markup=False)

    count = len(report["robots"])
    robots = "1 robot" if count == 1 else f"{count} robots"
    echo(f"{report['name']}: {robots} at {report['rate_hz']:g} Hz; {report['file']} is valid")
    for robot in report["robots"]:
        echo(f"\n{robot['name']}: {robot['model']} at ({_numbers(robot['base_mm'])}) mm")
        if robot["kinematics"] != robot["model"]:
            echo(f"  inverse: {robot['kinematics'].rpartition('.')[2]}")
        if not robot["passive"]:
            console.print(_axes(robot))
        for line in _passive(robot) if robot["passive"] else _driven(robot, columns[robot["name"]]):
            echo(f"  {line}")
        if robot["placeholders"]:
            echo(f"  placeholder values, measure these on your robot: {', '.join(robot['placeholders'])}")
    buses = Table("bus", "driver", "port", "axes", "misses allowed")
    for bus in report["buses"]:
        tolerance = f"{bus['tolerance_ticks']} ticks"
        _add_row(buses, bus["name"], bus["driver"], bus["port"], str(bus["axes"]), tolerance)
    echo("")
    console.print(buses)
    for bus in report["buses"]:
        if bus["exchange"]:
            echo(f"  {bus['name']}: {bus['exchange']}")
        if bus["unwatched"]:
            echo(f"  {bus['name']}: {bus['unwatched']}")


def _driven(robot: RobotReport, columns: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Lines of a robot with actuators, after the table of its axes."""
    yield f"rates: {_rates(robot)}"
    if robot["weight"]:
        yield f"gravity: {robot['weight']}"
    if robot["shape"]:
        yield f"shape: {robot['shape']}"
    if robot["feedback"]:
        yield f"feedback: {robot['feedback']}"
    yield "trajectory columns:"
    for kind, names in columns.items():
        yield f"  {_KINDS.get(kind, kind)}: {', '.join(names)}"
    yield f"stops: {', '.join(f'{key} {value}' for key, value in robot['stop'].items())}"


def _passive(robot: RobotReport) -> Iterator[str]:
    """Lines of a robot without actuators; a chain is one: its arms are robots of their own in the file."""
    yield "passive: it has no actuators of its own"
    if robot["chain"] is not None:
        yield from _chain(robot["chain"])


def _chain(chain: ChainReport) -> Iterator[str]:
    """A line for each link from base to base, and one for the bases and the floor below the rope."""
    first, second = (
        f"arm {arm['name']} on its base at ({_numbers(arm['base_mm'])}) mm" for arm in chain["arms"]
    )
    mass = "mass not stated" if chain["mass_g"] is None else f"{chain['mass_g']:g} g"
    curve = "one curve" if chain["pieces"] == 1 else f"{chain['pieces']} curves"
    yield f"link 1: {first}"
    yield f"link 2: rope of {chain['length_mm']:g} mm, {mass}, {chain['ends']} at both ends, {curve}"
    yield f"link 3: {second}"
    yield f"bases {chain['bases_apart_mm']:g} mm apart; the rope stays above z = {chain['floor_mm']:g} mm"


def _axes(robot: RobotReport) -> Table:
    table = Table("axis", "from", "to", "unit", "bus", "device", "address")
    for axis in robot["axes"]:
        limits = ("" if end is None else f"{end:g}" for end in (axis["min"], axis["max"]))
        _add_row(table, axis["name"], *limits, axis["unit"], axis["bus"], axis["device"], axis["address"])
    return table


def _add_row(table: Table, *cells: str) -> None:
    """Add cells as they are: Rich would take a part in brackets, such as of a port, as markup."""
    table.add_row(*map(Text, cells))


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _rates(robot: RobotReport) -> str:
    unit = robot["unit"]
    return (
        f"velocity {robot['velocity']:g} {unit}/s, acceleration {robot['acceleration']:g} {unit}/s2, "
        f"jerk {robot['jerk']:g} {unit}/s3"
    )
