"""The report of ``contid check`` as tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

from rich.console import Console
from rich.table import Table

from contid.robot_file.summary import ChainReport, FileReport, RobotReport

#: Names of the kinds of target.
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

    A passive robot has no actuators; a chain, two arms joined by a rope, is one: its arms are robots of their
    own in the file and move it.

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
        base = ", ".join(f"{value:g}" for value in robot["base_mm"])
        echo(f"\n{robot['name']}: {robot['model']} at ({base}) mm")
        if robot["kinematics"] != robot["model"]:
            echo(f"  inverse: {robot['kinematics'].rpartition('.')[2]}")
        if robot["passive"]:
            echo("  passive: it has no actuators of its own")
            if robot["chain"] is not None:
                for line in _chain(robot["chain"]):
                    echo(f"  {line}")
            _placeholders(robot, echo)
            continue
        console.print(_axes(robot))
        echo(f"  rates: {_rates(robot)}")
        if robot["weight"]:
            echo(f"  gravity: {robot['weight']}")
        if robot["shape"]:
            echo(f"  shape: {robot['shape']}")
        echo("  trajectory columns:")
        for kind, names in columns[robot["name"]].items():
            echo(f"    {_KINDS.get(kind, kind)}: {', '.join(names)}")
        echo(f"  stops: {', '.join(f'{key} {value}' for key, value in robot['stop'].items())}")
        _placeholders(robot, echo)
    buses = Table("bus", "driver", "port", "axes", "misses allowed")
    for bus in report["buses"]:
        tolerance = f"{bus['tolerance_ticks']} ticks"
        buses.add_row(bus["name"], bus["driver"], bus["port"], str(bus["axes"]), tolerance)
    echo("")
    console.print(buses)
    for bus in report["buses"]:
        if bus["exchange"]:
            echo(f"  {bus['name']}: {bus['exchange']}")
        if bus["unwatched"]:
            echo(f"  {bus['name']}: {bus['unwatched']}")


def _placeholders(robot: RobotReport, echo: Callable[[str], None]) -> None:
    if robot["placeholders"]:
        echo(f"  placeholder values, measure these on your robot: {', '.join(robot['placeholders'])}")


def _chain(chain: ChainReport) -> Iterator[str]:
    """A line for each link from base to base, and one for the bases and the floor below the rope."""
    first, second = (
        f"arm {arm['name']} on its base at ({', '.join(f'{value:g}' for value in arm['base_mm'])}) mm"
        for arm in chain["arms"]
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
        table.add_row(axis["name"], *limits, axis["unit"], axis["bus"], axis["device"], axis["address"])
    return table


def _rates(robot: RobotReport) -> str:
    unit = robot["unit"]
    return (
        f"velocity {robot['velocity']:g} {unit}/s, acceleration {robot['acceleration']:g} {unit}/s2, "
        f"jerk {robot['jerk']:g} {unit}/s3"
    )
