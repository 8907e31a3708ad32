"""`contid fleet`: the table of all nodes, and the report of a stop."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from rich.table import Table
from rich.text import Text

from contid.cli.support.orders import UNCONFIRMED
from contid.remote.protocol.wire import Fields

if TYPE_CHECKING:
    from contid_fleet.operator import Answers
    from contid_fleet.stops import StopReport

#: What to do when a node did not confirm.
REMEDY: Final = "look at the robots and use the emergency switch; a stop by network is best effort"


def render_nodes(answers: Answers) -> Table:
    """One line per robot of every node."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for heading in ("node", "robot", "state", "tip mm", "lease", "data", "notes"):
        table.add_column(heading)
    for name in sorted({*answers.by_node, *answers.missing}):
        response = answers.by_node.get(name)
        if response is None:
            table.add_row(name, "", Text("no answer", style="bold red"))
        elif not response.get("ok"):
            table.add_row(name, "", Text(response["error"]["message"], style="red"))
        else:
            _node(table, name, response["result"], name in answers.doubled)
    return table


def _node(table: Table, name: str, status: Fields, doubled: bool) -> None:
    ages = [bus["age_ms"] for bus in status["buses"].values() if bus["age_ms"] is not None]
    age = f"{max(ages):.1f} ms" if ages else "-"
    notes = ["two nodes have this name"] if doubled else []
    for robot, fields in status["robots"].items():
        fault = fields.get("fault")
        found = [*notes, *([f"fault {fault['number']} {fault['name']}"] if fault else [])]
        tip = fields.get("tip_mm")
        table.add_row(
            name,
            robot,
            Text(fields["state"], style="bold red" if fault else ""),
            "-" if tip is None else ", ".join(f"{value:.1f}" for value in tip),
            status["lease"].get("by") or status["lease"]["holder"] or "free",
            age,
            ", ".join(found),
        )


def stop_lines(report: StopReport, timeout_s: float) -> Iterator[str]:
    """The report of a stop, by node."""
    for name, each in report.confirmed.items():
        states = ", ".join(f"{robot} {state}" for robot, state in each.robots.items())
        when = "before its run began" if each.tick is None else f"in tick {each.tick}"
        yield f"{name}: {report.verb} confirmed {when}: {states}"
        for robot, axes in each.silent.items():
            yield f"{name}: {robot}: {', '.join(axes)} did not answer and may have missed it: {UNCONFIRMED}"
        for robot, message in each.refused.items():
            yield f"{name}: {robot}: refused: {message}"
    for name, message in report.refused.items():
        yield f"{name}: NOT CONFIRMED: {message}"
    for name in report.missing:
        yield f"{name}: NO ANSWER within {timeout_s:g} s"
    for name in report.doubled:
        yield f"{name}: several nodes have this name; one of them may not have confirmed"
    if report.unlinked:
        yield f"{report.unlinked} of the endpoints of the file: NO LINK"
