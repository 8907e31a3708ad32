"""The state of one robot; `contid.control.tick.transitions` changes it."""

from __future__ import annotations

import enum
from typing import Final, TypeAlias

from contid.control.tick.faults import Fault
from contid.control.tick.play import NO_LEAD, Lead
from contid.control.tick.shaping import NOT_SHAPED, Shaped
from contid.control.tick.squeezing import Squeeze
from contid.control.tick.supervisor import Mode
from contid.control.tick.tip_feedback import Correction
from contid.errors import ContidError
from contid.hal import Rest
from contid.records import record
from contid.robot_file.base import StopPolicy
from contid.targets import Actuation, Solution, Target, Vec3
from contid.trajectory.approach import Approach, ApproachAfterStop
from contid.trajectory.pursuit import MovingAxes
from contid.trajectory.standstill import JerkLimitedStop, JointStop
from contid.trajectory.straight_stop import StraightStop

NO_CORRECTION: Final = Correction()

#: Part of a tick by which the clocks of paths go on in a tick, newest first.
PathPaces: TypeAlias = tuple[float, float, float]
FULL_PACE: Final[PathPaces] = (1.0, 1.0, 1.0)

#: A motion in actuator space.
AxisMotion: TypeAlias = Approach | ApproachAfterStop | JerkLimitedStop | JointStop | StraightStop


class Effect(enum.Enum):
    """A request of a robot to its devices."""

    ENABLE = "enable"
    CLEAR = "clear"
    HOLD = Rest.HOLD
    RELAX = Rest.RELAX
    VENT = Rest.VENT


@record(frozen=True, slots=True)
class GuardState:
    """What `contid.control.tick.jerk_guard` keeps of the ticks before.

    Attributes:
        joined_s: when the robot began to follow.
        paces: last step of the model's answer.
        motion: of axes that are not on the answer, None on it.
        brakes: a tendon robot stops before it goes on to the answer.
    """

    joined_s: float
    paces: Actuation
    motion: MovingAxes | None
    brakes: bool = False


@record(frozen=True, slots=True)
class Answered:
    """An answer of the model.

    Attributes:
        target_in_base: the target.
        seed: from where the model was asked.
        solution: what it answered.
        joined_s: when the robot began to follow.
        searched_m: tip of the target for which poses were searched for everywhere last, None without a tip.
    """

    target_in_base: Target
    seed: Actuation
    solution: Solution
    joined_s: float
    searched_m: Vec3 | None


class OrderRefusedError(ContidError):
    """The state of the robot does not allow an order; the message lists what is allowed."""


@record(frozen=True, slots=True)
class RobotState:
    """Everything that changes about one robot.

    Attributes:
        mode: of the supervisor.
        since_s: when the mode was entered.
        fault: latched; NONE without a fault.
        message: cause of the fault.
        enabled: the devices accept commands.
        arm_requested: arm once READY.
        follow: follow the source; False after a hold order.
        goto: single target to go to, then hold.
        command: last commanded actuation; empty before arming.
        increments: last command minus the one before.
        before: increments of the tick before; empty where they are not known.
        reference: last actuation before the limits.
        motion: running approach or stop.
        motion_s: its start, at the previous command: the next tick is one period into it.
        policy: of the stop that runs.
        misses: exchanges in a row that each axis missed.
        pending: next requests to the devices, in the order in which they are asked.
        correction: of the closed loop on the tip.
        recovering: to move inside the limits slowly once armed, or on the way.
        lead: what is added to commands to lead play and friction of the drives; none at rest.
        straight: the axes go on a straight line to the answer (`contid.control.tick.ways.way`).
        squeeze: the tip closes until a force, or holds it.
        guard: of a robot that follows live targets; None for one that does not.
        shaped: what goes to the devices of a robot whose commands are shaped.
        was_armed: its devices were asked to be ready in this run, so that they may have power.
        path_paces: in this tick and in the two before (`contid.control.engine.watch.path_pace`).
        missed: answer to the target of the last tick, where that was out of reach; None otherwise.
    """

    mode: Mode = Mode.OFF
    since_s: float = 0.0
    fault: Fault = Fault.NONE
    message: str = ""
    enabled: bool = False
    arm_requested: bool = False
    follow: bool = False
    goto: Target | None = None
    command: Actuation = ()
    increments: Actuation = ()
    before: Actuation = ()
    reference: Actuation = ()
    motion: AxisMotion | None = None
    motion_s: float = 0.0
    policy: StopPolicy | None = None
    misses: tuple[int, ...] = ()
    pending: tuple[Effect, ...] = ()
    correction: Correction = NO_CORRECTION
    recovering: bool = False
    lead: Lead = NO_LEAD
    straight: bool = False
    squeeze: Squeeze | None = None
    guard: GuardState | None = None
    shaped: Shaped = NOT_SHAPED
    was_armed: bool = False
    path_paces: PathPaces = FULL_PACE
    missed: Answered | None = None
