"""The closing report of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from contid.control.engine.engine import Engine
from contid.control.engine.tick_layout import CONVERGED, RecordLayout, TickRecord
from contid.control.engine.watch.settling import AxisPlace, has_arrived
from contid.control.tick.faults import Fault, describe
from contid.control.tick.next_command import tip_tolerance_m
from contid.control.tick.statistics import Lateness, RobotTally
from contid.control.tick.supervisor import Mode
from contid.kernels import in_use
from contid.units import m_to_mm

#: A commanded tip that is farther off than the residual by this is shown: limits held the robot back.
SHOWN_MM: Final = 1e-6


@dataclass(slots=True)
class RunReport:
    """The closing report.

    Attributes:
        ending: why the run ended.
        exit_code: of the process (see docs).
        rate_hz: of the tick.
        virtual: True in virtual time, where no lateness exists.
        ticks: run.
        late: started more than a tenth of a period after their deadline.
        skipped: never started.
        waited: periods that passed while devices were connected, armed or cleared; they are no ticks.
        longest_gap_ms: longest time between two ticks that others were left out of; 0 when none was.
        slowest_hz: rate of the ticks where overload made them slowest; 0 for none (`OverloadChanged`).
        lateness: p50, p99, p99.9 and greatest [us].
        realtime: whether the control process ran under SCHED_FIFO.
        kernels: the arithmetic of the models, compiled or NumPy.
        robots: per robot its last state, fault, tip error and limits.
        buses: per bus what it counted on its wire.
        problems: messages about what failed.
    """

    ending: str = "did not start"
    exit_code: int = 0
    rate_hz: float = 0.0
    virtual: bool = False
    ticks: int = 0
    late: int = 0
    skipped: int = 0
    waited: int = 0
    longest_gap_ms: float = 0.0
    slowest_hz: float = 0.0
    lateness: dict[str, float] = field(default_factory=dict)
    realtime: bool = False
    kernels: str = field(default_factory=in_use)
    robots: dict[str, dict[str, Any]] = field(default_factory=dict)
    buses: dict[str, dict[str, int]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        """For ``--json``."""
        return {name: getattr(self, name) for name in self.__slots__}

    def faulted(self) -> bool:
        """True when a robot ended in FAULT, or with its tip off target."""
        return any(robot["fault"] for robot in self.robots.values())

    def __str__(self) -> str:
        """For a person."""
        lines = [f"run: {self.ending} (exit code {self.exit_code})"]
        accounted = f"{self.ticks} run, {self.late} late, {self.skipped} skipped"
        if self.waited:
            accounted += f", {self.waited} waited for arming"
        if self.longest_gap_ms:
            accounted += f", longest gap {self.longest_gap_ms:.0f} ms"
        lines.append(f"ticks: {accounted} at {self.rate_hz:g} Hz{' of virtual time' if self.virtual else ''}")
        if self.slowest_hz:
            lines.append(f"overload: ticks at {self.slowest_hz:g} Hz for a part of the run")
        if self.lateness and not self.virtual:
            figures = ", ".join(
                f"{key.removesuffix('_us')} {value:g}" for key, value in self.lateness.items()
            )
            how = "SCHED_FIFO" if self.realtime else "normal priority"
            lines.append(f"lateness [us]: {figures} ({how})".replace("p99_9", "p99.9"))
        lines.append(f"kernels: {self.kernels}")
        for name, robot in self.robots.items():
            lines.append(
                f"{name}: {robot['mode']}, {robot['ticks_followed']} ticks followed{_errors(robot)}"
                + "".join(f", {n} ticks at the {limit} limit" for limit, n in robot["ticks_limited"].items())
                + (f", {robot['ticks_unreachable']} unreachable" if robot["ticks_unreachable"] else "")
            )
            if robot.get("axes"):
                lines.append(f"{name}: {_places(robot['axes'])}")
            if robot["fault"]:
                lines.append(f"{name}: {robot['message']}")
        for name, counts in self.buses.items():
            lines.append(
                f"{name}: " + ", ".join(f"{count} {what.replace('_', ' ')}" for what, count in counts.items())
            )
        return "\n".join([*lines, *self.problems])


def _places(axes: Mapping[str, Mapping[str, float]]) -> str:
    """Commanded, measured and their difference at the end, of every axis."""
    return "axes " + ", ".join(
        f"{axis} {at['commanded']:.4g} measured {at['measured']:.4g} ({at['difference']:+.2g}"
        + (", pushes on something)" if "holds" in at else ")")
        for axis, at in axes.items()
    )


def _errors(robot: Mapping[str, Any]) -> str:
    """What the model, the limits and the robot left of the targets, side by side."""
    if not robot["ticks_followed"]:
        ticks = robot["ticks_approached"]
        return f"; {ticks} ticks on the way to a point, none along rows" if ticks else ""
    residual_mm, commanded_mm = robot["ik_residual_max_mm"], robot["tip_error_max_mm"]
    text = f"; IK residual max {residual_mm:.3g} mm"
    if commanded_mm > residual_mm + SHOWN_MM:
        text += f"; commanded tip error max {commanded_mm:.3g} mm, rms {robot['tip_error_rms_mm']:.3g} mm"
    if "measured_tip_error_max_mm" in robot:
        most, rms = robot["measured_tip_error_max_mm"], robot["measured_tip_error_rms_mm"]
        text += f"; measured tip error max {most:.3g} mm, rms {rms:.3g} mm"
    return text


def robot_reports(engine: Engine) -> dict[str, dict[str, Any]]:
    """The closing report of each robot."""
    out = {}
    robots = engine.robots
    for index, (config, state, tally) in enumerate(
        zip(robots.configs, robots.states, robots.tallies, strict=True)
    ):
        fault, message = state.fault, state.message
        faulted = state.mode is Mode.FAULT
        allowed_m = tip_tolerance_m(config.quantity)
        if fault is Fault.NONE and engine.selector.ended and tally.off_target_m > allowed_m:
            fault, message, faulted = Fault.TIP_OFF_TARGET, _off_target(tally, allowed_m), True
        places = engine.body_watch.places(index)
        if fault is Fault.NONE and engine.selector.ended and not has_arrived(places):
            fault, message, faulted = Fault.DOES_NOT_FOLLOW, _not_there(places), True
        out[config.name] = {
            "mode": state.mode.name,
            "fault": int(fault),
            "message": describe(fault, message) if faulted else "",
            "axes": {
                place.axis: {
                    "commanded": place.commanded,
                    "measured": place.measured,
                    "difference": place.measured - place.commanded,
                    **({"holds": True} if place.holds else {}),
                }
                for place in places
            },
            **tally.as_dict(),
        }
    return out


def _not_there(places: Sequence[AxisPlace]) -> str:
    return "the run ended, and the robot is not there: " + "; ".join(
        str(place) for place in places if not place.arrived
    )


def outrun(robots: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Warnings for robots that live rows asked for more than their limits allow.

    A robot that has to catch up with rows that went on during its approach was not asked for more.
    """
    out = []
    for name, robot in robots.items():
        limited = robot["ticks_limited"]
        if limited and robot["behind_max_mm"] > SHOWN_MM:
            counts = ", ".join(f"{limit} in {count}" for limit, count in limited.items())
            out.append(
                f"warning: {name}: the live rows outran its limits ({counts} of {robot['ticks_followed']} "
                f"ticks); its commanded tip was up to {robot['behind_max_mm']:.3g} mm behind: send rows "
                "closer together, or more slowly"
            )
    return out


def _off_target(tally: RobotTally, allowed_m: float) -> str:
    limits = ", ".join(tally.as_dict()["ticks_limited"])
    if tally.missed_m == tally.off_target_m:
        return (
            f"a target that was within reach when it was checked was out of reach by "
            f"{m_to_mm(tally.missed_m):.3g} mm"
        )
    return (
        f"the commanded tip was up to {m_to_mm(tally.off_target_m):.3g} mm off its targets, "
        f"the tolerance is {m_to_mm(allowed_m):g} mm" + (f"; limits that bound: {limits}" if limits else "")
    )


#: Of a control process that was killed.
LAST_TICK: Final = (
    "the states of the robots are those of their last tick: devices stop by their own watchdogs, and servos "
    "may keep their torque"
)


def complete_from_records(
    report: RunReport, layout: RecordLayout, written: int, records: Sequence[TickRecord]
) -> None:
    """Complete the report from the ring when the control process was killed.

    Counts are complete; lateness and tip errors cover the records of the last seconds only.
    """
    if report.ticks or not records:
        return
    lateness, tallies = Lateness(), [RobotTally() for _ in layout.robots]
    for record in records:
        lateness.add(record.lateness_s)
        for robot, tally in zip(record.robots, tallies, strict=True):
            if robot.tip_error_m == robot.tip_error_m:
                tally.add(robot.tip_error_m, bool(robot.flags & CONVERGED), robot.residual_m)
    last = records[-1]
    if any(Mode(robot.mode) is not Mode.OFF for robot in last.robots):
        report.problems.append(LAST_TICK)
    report.ticks, report.skipped, report.lateness = written, last.skipped, lateness.as_dict()
    for name, robot, tally in zip(layout.robots, last.robots, tallies, strict=True):
        fault = Fault(robot.fault)
        report.robots[name.name] = {
            "mode": Mode(robot.mode).name,
            "fault": robot.fault,
            "message": describe(fault, fault.name) if fault else "",
            **tally.as_dict(),
        }
