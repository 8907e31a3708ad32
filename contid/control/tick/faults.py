"""Every fault a robot can latch: one table for messages, ``--json`` and the documentation.

A fault stops one robot by its ``stop.on_fault`` policy and stays until ``clear-fault``; the other robots go
on, but for those of the same closed chain. Numbers never change their meaning: 1xx the devices, 2xx the
arithmetic, 3xx other robots and obstacles.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Final

from contid.hal import SLACK_TENDON, SNAPPED_TENDON


class Fault(enum.IntEnum):
    """Numbers of the faults; 0 is none."""

    NONE = 0
    DEVICE_LOST = 101
    AXIS_SILENT = 102
    DEVICE_FAULT = 103
    NO_SAMPLE = 104
    ARM_REFUSED = 105
    BUS_STALLED = 106
    AXIS_STALE = 107
    LOOP_STALLED = 108
    OUTSIDE_LIMITS = 109
    TENDON_SLACK = 110
    TENDON_SNAPPED = 111
    DOES_NOT_FOLLOW = 112
    MOVES_UNASKED = 113
    IMPLAUSIBLE_SAMPLE = 114
    DRIVER_ENDED = 115
    NOT_A_NUMBER = 201
    INTERNAL = 202
    TIP_OFF_TARGET = 203
    MODEL_TOO_SLOW = 204
    MODEL_ENDED = 205
    CHAIN_FORBIDS = 301
    CHAIN_BROKEN = 302
    TOO_NEAR = 303
    CONTACT = 304


#: Faults after which nothing asks the model any more: it may be what failed.
WITHOUT_MODEL: Final = (Fault.INTERNAL, Fault.MODEL_TOO_SLOW, Fault.MODEL_ENDED, Fault.NOT_A_NUMBER)


@dataclass(frozen=True, slots=True)
class FaultPage:
    """What a person needs to know about a fault.

    Attributes:
        cause: what happened.
        reaction: what the robot did.
        remedy: what to do next.
    """

    cause: str
    reaction: str
    remedy: str


_BY_POLICY = "this robot stopped by its stop.on_fault policy; the others go on"

PAGES: Final[dict[Fault, FaultPage]] = {
    Fault.DEVICE_LOST: FaultPage(
        "a bus that was open is gone: unplugged, switched off, or its port failed",
        "every robot on that bus went to FAULT; its devices stop by their own watchdog; the others go on",
        "check cable and supply; the bus is reopened by itself, then clear-fault and resume",
    ),
    Fault.AXIS_SILENT: FaultPage(
        "an axis missed buses.NAME.tolerance_ticks exchanges in a row",
        _BY_POLICY,
        "check that device's cable, supply and id; then clear-fault and resume",
    ),
    Fault.DEVICE_FAULT: FaultPage(
        "a device reports a fault of its own (overload, overheating, voltage, watchdog, torque lost)",
        _BY_POLICY,
        "do what the message of the device asks; clear-fault also clears the device, then resume",
    ),
    Fault.NO_SAMPLE: FaultPage(
        "no valid first sample came from every axis in time",
        "nothing was commanded, torque was not touched",
        "check the named axis with `contid scan` or `contid doctor`; then clear-fault and resume",
    ),
    Fault.ARM_REFUSED: FaultPage(
        "the bus refused to make the axes ready to move",
        "nothing was commanded",
        "read the message of the device; then clear-fault and resume",
    ),
    Fault.BUS_STALLED: FaultPage(
        "an exchange did not come back for tolerance_ticks ticks",
        "every robot on that bus went to FAULT; its devices stop by their own watchdog; the others go on",
        "lower rate_hz or the number of axes on this bus; `contid doctor` names slow ports",
    ),
    Fault.AXIS_STALE: FaultPage(
        "an axis answers, but with a measurement that is older than tolerance_ticks ticks and 0.1 s",
        _BY_POLICY,
        "its device repeats old data: reset or replace it; then clear-fault and resume",
    ),
    Fault.LOOP_STALLED: FaultPage(
        "the loop of contid stood still, so no exchange reached the device before its watchdog expired",
        "the device stopped by its own watchdog, then this robot by its stop.on_fault policy",
        "let the control process use real-time priority (`contid doctor`) or take load from this computer; "
        "then clear-fault and resume",
    ),
    Fault.OUTSIDE_LIMITS: FaultPage(
        "an axis was found outside its limits when it was armed, by more than 2 % of its travel",
        "nothing moved: this robot stays where it is by its stop.on_fault policy",
        "check zero and limits; then `contid recover` moves it inside slowly, and resume goes on",
    ),
    Fault.TENDON_SLACK: FaultPage(
        "the current of a spool stayed below homing.slack_ma for homing.slack_ms while it did not pay out",
        _BY_POLICY,
        "see whether the tendon left its spool or a disc, or the robot was pushed; clear-fault, then "
        "`contid home` tensions it again; if a taut tendon carries less at rest, lower slack_ma",
    ),
    Fault.TENDON_SNAPPED: FaultPage(
        "the current of a spool fell at once from much to less than homing.slack_ma and stayed there",
        _BY_POLICY,
        "replace the tendon or tie its knot again; clear-fault, then `contid home`",
    ),
    Fault.DOES_NOT_FOLLOW: FaultPage(
        "an axis was measured farther from where its commands should have brought it than follow_mm, "
        "follow_bar or follow_deg, or the tip than follow_tip_mm, for 20 ms, or it was not there when the "
        "run ended",
        _BY_POLICY,
        "see what holds it: a blocked shaft, a slipped horn, a hose that is off, a stuck valve, crossed "
        "wires, a dead encoder, a device slower than rates; clear-fault, then resume; if the device is only "
        "slow, raise follow_lag_ms or lower rates",
    ),
    Fault.MOVES_UNASKED: FaultPage(
        "an axis that was commanded to stand was measured farther from its command than follow_mm, "
        "follow_bar or follow_deg, for 20 ms",
        _BY_POLICY,
        "see what moved it: a push, a leak, a horn or an encoder that slips; clear-fault, then resume",
    ),
    Fault.IMPLAUSIBLE_SAMPLE: FaultPage(
        "a measurement jumped farther than a body moves in one tick, is dated more than 0.1 s in the future, "
        "or is no number (tolerance_ticks times in a row)",
        _BY_POLICY,
        "check encoder, cable and supply of the axis, and its driver if others wrote it; clear-fault, then "
        "resume",
    ),
    Fault.DRIVER_ENDED: FaultPage(
        "the process of a bus's driver ended (crash, exit, 0.5 s of computation without a pause), or was "
        "ended because it did not answer for 0.5 s",
        "every robot on that bus went to FAULT; its devices stop by their own watchdog; the others go on",
        "read the message and the log lines of the bus before it; the process is started again by itself, "
        "then clear-fault and resume; report it with those to the author of the driver",
    ),
    Fault.NOT_A_NUMBER: FaultPage(
        "the model answered a target with something that is not a number",
        _BY_POLICY,
        "this is a defect of the model: report it with the recording",
    ),
    Fault.INTERNAL: FaultPage(
        "the tick of this robot failed with an error of contid, or of a model of others",
        _BY_POLICY,
        "this is a defect of contid, or of that model: report it with the message and the recording",
    ),
    Fault.TIP_OFF_TARGET: FaultPage(
        "the run ended by itself, but the commanded tip was off its path or its last target (or the nearest "
        "point to that) by more than 1e-6 mm (lengths) or 0.05 mm (pressures)",
        "nothing: the error is found when the run ends, by its closing report",
        "play the path more slowly where a rate limited it; else report this defect of the model, with "
        "the recording",
    ),
    Fault.MODEL_TOO_SLOW: FaultPage(
        "the tick of this robot alone took longer than 0.1 s and three periods, while it had a processor; or "
        "its model, of a package of others, did not answer a question within half a period, or "
        "0.1 s where the file has one robot",
        "its model was interrupted and is not asked again; " + _BY_POLICY,
        "make the model faster, or lower rate_hz; a model of contid: report it with the recording",
    ),
    Fault.MODEL_ENDED: FaultPage(
        "the process of this robot's model, of a package of others, ended (crash, exit)",
        _BY_POLICY,
        "read the message and the log lines of the model before it; the process is started again by itself, "
        "then clear-fault and resume; report it with those to the author of the model",
    ),
    Fault.CHAIN_FORBIDS: FaultPage(
        "on the way to the first target the rope between two arms would be too short, or below its floor",
        "nothing moved: this robot stays where it is and holds",
        "clear-fault, then `contid move` the arms by a way the rope allows, or begin elsewhere; then resume",
    ),
    Fault.CHAIN_BROKEN: FaultPage(
        "another arm of the same closed chain went to FAULT",
        "this robot stopped by its own stop.on_fault policy",
        "fix the fault reported by that arm; then clear-fault and resume, both of them",
    ),
    Fault.TOO_NEAR: FaultPage(
        "the next command, or the stop that would follow it, brings a body nearer to another robot, to "
        "itself or to an obstacle than clearance.margin_mm, or two tips deeper into each other than "
        "clearance.tip_depth_mm",
        "it stopped before that in the shortest way and holds, whatever its stop.on_fault policy; so did the "
        "other robot if it moved",
        "clear-fault, then `contid move` away; a checked trajectory ends here where tip feedback moves it, "
        "or when it began elsewhere",
    ),
    Fault.CONTACT: FaultPage(
        "something pushed on the robot that its model and its load do not explain, and sense.contact is stop",
        _BY_POLICY,
        "see what it touched; clear-fault, then `contid move` away from it, or resume; if nothing was there, "
        "calibrate again (docs/sensing.md)",
    ),
}


def of_device(text: str) -> Fault:
    """The fault of what a device reports about itself."""
    for beginning, fault in ((SLACK_TENDON, Fault.TENDON_SLACK), (SNAPPED_TENDON, Fault.TENDON_SNAPPED)):
        if text.startswith(beginning):
            return fault
    return Fault.DEVICE_FAULT


def describe(fault: Fault, message: str) -> str:
    """One line for a log: number, name, what exactly, what to do."""
    return f"fault {int(fault)} {fault.name.lower().replace('_', '-')}: {message}; {PAGES[fault].remedy}"


def markdown() -> str:
    """The table as the page docs/faults.md."""
    lines = [
        "# Faults",
        "",
        "A fault stops one robot (and the other arm of its chain) and stays until `contid clear-fault`;",
        "a run with one ends with exit code 3.",
        "Numbers never change their meaning: 1xx devices, 2xx arithmetic, 3xx other robots and obstacles.",
        "112 to 114 come from [the watch of the body](devices/watching.md), which slows a path before 112.",
        "",
        "| number | name | cause | what the robot did | what to do |",
        "|---|---|---|---|---|",
    ]
    for fault, page in PAGES.items():
        name = fault.name.lower().replace("_", "-")
        link = f"[{int(fault)}](faults/{int(fault)}.md)"
        lines.append(f"| {link} | {name} | {page.cause} | {page.reaction} | {page.remedy} |")
    return "\n".join(lines) + "\n"
