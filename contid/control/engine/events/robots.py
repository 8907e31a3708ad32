"""What happens to a robot: its mode, faults, contacts, limits and closing report; what becomes of orders."""

from __future__ import annotations

from typing import Annotated, Any

from contid.control.engine.events import RobotName, RunEvent, Text, TickNumber, run_event
from contid.control.tick.faults import Fault


@run_event("state")
class ModeChanged(RunEvent):
    """A robot entered a mode."""

    robot: RobotName
    mode: Annotated[str, "new mode of the robot"]
    tick: TickNumber


@run_event("fault")
class FaultLatched(RunEvent):
    """A robot entered FAULT."""

    robot: RobotName
    fault: Annotated[int, "number of the fault"]
    name: Annotated[str, "name of the fault"]
    message: Text
    detail: Annotated[str, "what happened, without the remedy"] = ""
    tick: TickNumber


@run_event("path")
class PathSlowed(RunEvent):
    """A body is behind by more than its devices explain, so its path is slowed; or it follows again."""

    tick: TickNumber
    robot: RobotName
    axis: Annotated[str, "ROBOT.AXIS that is farthest behind"]
    over: Annotated[bool, "it follows again"]
    lost_s: Annotated[float, "how much longer the path took, once that is over [s]"]
    message: Text


@run_event("contact")
class ContactBegan(RunEvent):
    """A force acts on a robot that neither its model nor its known load explains."""

    tick: TickNumber
    robot: RobotName
    axis: Annotated[str, "axes whose currents showed it, empty for the tip"] = ""
    time_s: Annotated[float, "capture of the measurement that showed it, in the time of the robots"]
    direction: Annotated[list[float], "of the force, unit vector in the world frame; empty where it has none"]
    force_n: Annotated[float, "size of the force on the tip when it was found [N]; 0 for an axis"]
    excess_ma: Annotated[float, "current above the usual one [mA]; 0 for the tip"] = 0.0
    confidence: Annotated[float, "1 minus the number of such events by noise alone expected in an hour"]
    policy: Annotated[str, "reaction: ignore, hold, stop or retract"]
    message: Text


@run_event("squeeze")
class SqueezeChanged(RunEvent):
    """A motion of a tip until a force (`Goto.until_force_n`) reached the force, lost the object, or ended."""

    tick: TickNumber
    robot: RobotName
    what: Annotated[str, "reached, lost, nothing (no force up to the target), pressed (no free way), weak"]
    force_n: Annotated[float, "force of the tip along its way, from the currents [N]"]
    message: Text


@run_event("grip")
class EffortLimited(RunEvent):
    """The effort of a robot was limited to a share of that of the robot file."""

    tick: TickNumber
    robot: RobotName
    share: Annotated[float, "share, 0 to 1"]


@run_event("limit_name")
class LimitNamed(RunEvent):
    """A bit of ``limited_by`` was assigned to a limit."""

    robot: RobotName
    bit: Annotated[int, "bit of limited_by"]
    name: Annotated[str, "name of the limit"]


@run_event("robot")
class RobotReported(RunEvent):
    """The closing report of a robot (`contid.control.engine.report.robot_reports`)."""

    robot: RobotName
    report: Annotated[dict[str, Any], "mode, fault, tip errors and limits"]


@run_event("overran")
class RobotOverran(RunEvent):
    """The model of a robot did not answer a question, which was given up; a replay needs it."""

    tick: TickNumber
    robot: RobotName
    message: Text
    fault: Annotated[int, "number of the fault"] = int(Fault.MODEL_TOO_SLOW)
    question: Annotated[int, "which beside the tick of the robot, counted from 0; -1 for that tick"] = -1


@run_event("order")
class OrderGiven(RunEvent):
    """An order reached the engine before a tick; its JSON has the keys of ``order`` itself."""

    tick: TickNumber
    order: Annotated[dict[str, Any], "which order"]


@run_event("refused")
class OrderRefused(RunEvent):
    """An order, or a part of one, was not carried out."""

    robot: RobotName = ""
    message: Text
    answers: Annotated[int, "number of the mark behind the order that was refused; 0 beside orders"] = 0
    stronger: Annotated[str, "policy of an earlier stop, which goes on and leaves less power"] = ""


@run_event("mark")
class MarkReached(RunEvent):
    """Every order sent before a `contid.control.engine.messages.Mark` was carried out or refused."""

    number: Annotated[int, "of the mark"]
    tick: TickNumber


@run_event("goto")
class GotoEnded(RunEvent):
    """A robot reached the target of a goto, or gave up on it."""

    robot: RobotName
    arrived: Annotated[bool, "the robot holds at the target, by command and by measurement"]
    tick: TickNumber
    message: Annotated[str, "which axes are not there, with commanded, measured and their difference"] = ""
