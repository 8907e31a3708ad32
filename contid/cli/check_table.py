"""The report of ``contid check`` as tables."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from contid.description.summary import FileReport, RobotReport


def print_report(report: FileReport) -> None:
    """Print robots, axes, buses, limits, rate and what is a placeholder."""
    console = Console(highlight=False)

    def say(line: str) -> None:
        console.print(line, soft_wrap=True, markup=False)

    count = len(report["robots"])
    robots = "1 robot" if count == 1 else f"{count} robots"
    say(f"{report['name']}: {robots} at {report['rate_hz']:g} Hz; {report['file']} is valid")
    for robot in report["robots"]:
        base = ", ".join(f"{value:g}" for value in robot["base_mm"])
        say(f"\n{robot['name']}: {robot['model']} at ({base}) mm")
        if robot["passive"]:
            say("  passive: it has no actuators of its own")
            continue
        console.print(_axes(robot))
        say(f"  rates: {_rates(robot)}")
        say(f"  takes: {', '.join(robot['accepts'])}")
        say(f"  stops: {', '.join(f'{key} {value}' for key, value in robot['stop'].items())}")
        if robot["placeholders"]:
            say(f"  placeholders (numbers no one measured): {', '.join(robot['placeholders'])}")
    buses = Table("bus", "driver", "port", "axes", "misses allowed")
    for bus in report["buses"]:
        tolerance = f"{bus['tolerance_ticks']} ticks"
        buses.add_row(bus["name"], bus["driver"], bus["port"], str(bus["axes"]), tolerance)
    say("")
    console.print(buses)


def _axes(robot: RobotReport) -> Table:
    table = Table("axis", f"from ({robot['unit']})", f"to ({robot['unit']})", "bus", "device", "address")
    for axis in robot["axes"]:
        ends = ("" if end is None else f"{end:g}" for end in (axis["least"], axis["greatest"]))
        table.add_row(axis["name"], *ends, axis["bus"], axis["device"], axis["address"])
    return table


def _rates(robot: RobotReport) -> str:
    unit = robot["unit"]
    return (
        f"velocity {robot['velocity']:g} {unit}/s, acceleration {robot['acceleration']:g} {unit}/s2, "
        f"jerk {robot['jerk']:g} {unit}/s3"
    )
