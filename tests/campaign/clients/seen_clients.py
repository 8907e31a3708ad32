"""What must hold of a run that clients and faults fought over, and of its exit code by its last records."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from typing import TYPE_CHECKING

from contid.control.engine.events.robots import GotoEnded
from contid.control.engine.events.run import LogWritten
from contid.errors import ContidError
from tests.campaign.clients.seen import Seen
from tests.campaign.clients.seen_motion import alone, motion, replayed
from tests.campaign.clients.seen_orders import answers, moves, off_target, onsets
from tests.campaign.clients.seen_power import power, rest

if TYPE_CHECKING:
    from tests.campaign.clients.failing_devices import Case


def checked(case: Case) -> list[str]:
    """Everything that was wrong."""
    if "Traceback" in case.stderr or "never retrieved" in case.stderr:
        return [case.stderr[-3000:]]
    try:
        seen = Seen(case)
    except ContidError as error:
        return [f"no recording: {error}: exit {case.code}: {case.stderr[-800:]}"]
    if not seen.records:
        return [f"no ticks: exit {case.code}: {case.stderr[-800:]}"]
    return [*checks(seen), *(f"exit_code: {each}" for each in exit_code(seen))]


def checks(seen: Seen) -> list[str]:
    """What was wrong in the recording of a run."""
    found = []
    for check in (answers, onsets, motion, replayed, alone, power, rest, moves, untouched):
        try:
            found += [f"{check.__name__}: {each}" for each in check(seen)]
        except Exception:  # a defect of the check is to be seen
            found.append(f"{check.__name__}: {traceback.format_exc()[-600:]}")
    return found


def exit_code(seen: Seen) -> Iterator[str]:
    """3 after a fault at the end, 0 only where the measured robots are at the end of the trajectory."""
    case, last = seen.case, seen.records[-1]
    faults = {
        name: last.robots[place].fault for name, place in seen.places.items() if last.robots[place].fault
    }
    reported = {
        name: robot["fault"] for name, robot in case.report.get("robots", {}).items() if robot["fault"]
    }
    if case.code not in (0, 3, 130):
        yield f"exit code {case.code}: {case.stderr[-500:]}"
    if faults and case.code != 3:
        yield f"exit code {case.code} with faults {faults}"
    if case.code == 3 and not faults and not reported:
        yield f"exit code 3 without a fault: {case.report.get('ending')} {case.report.get('problems')}"
    if case.code == 0:
        if not case.input:
            yield "exit code 0 of a run that was interrupted"
        rows = (case.folder / "c.csv").read_text().splitlines()
        head, tail = rows[0].split(","), [float(each) for each in rows[-1].split(",")]
        touched = {name for name in seen.configs for _, o in seen.for_robot(name)
                   if o["order"] not in ("measured", "finish", "grip")}  # fmt: skip
        for robot in ("f0", "f1"):
            goal = {c.split(".")[1]: v for c, v in zip(head, tail, strict=True) if c.startswith(f"{robot}.")}
            values = [axis.value for axis in last.robots[seen.places[robot]].axes]
            off = off_target(seen.configs[robot], seen.configs[robot].transmission.to_actuation(values), goal)
            if off > 3.0 and robot not in touched:
                yield f"exit code 0, and {robot} is measured {off:.3g} mm from the end of its trajectory"
    for word in ("did not end", "stood still"):
        if word in case.stderr:
            yield case.stderr[-600:]


def untouched(seen: Seen) -> Iterator[str]:
    """Gotos end in the order that they have in the recording, each once; a log has no defect."""
    for event in seen.events:
        if isinstance(event, LogWritten) and ("Error" in event.message or "Traceback" in event.message):
            yield f"log: {event.message[:300]}"
    for robot in seen.configs:
        begun = sum(o["order"] == "goto" for _, o in seen.for_robot(robot))
        ended = sum(isinstance(e, GotoEnded) and e.robot == robot for e in seen.events)
        if ended > begun:
            yield f"{robot}: {ended} gotos ended, {begun} began"
