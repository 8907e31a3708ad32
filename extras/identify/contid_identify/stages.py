"""Everything that is identified from the recordings of one robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.kinematics.batch import forward_many
from contid.kinematics.model import build_model
from contid.robot_file.robot import RobotDescription
from contid_identify.body_fit import BodyFit, fit_body
from contid_identify.delay_lag import AxisAnswer, fit_axis
from contid_identify.excitation import Excitation, excitation_of
from contid_identify.recording import RobotRecording
from contid_identify.ring_down import RingDown, decays_of, fit_ring_downs
from contid_identify.tip_answer import LEAST_TIPS, TipAnswer, fit_tip
from contid_identify.tip_motion import TipMotion
from contid_identify.tip_motion_fit import LoadedTrace, fit_tip_motion


@dataclass(frozen=True, slots=True)
class Rests:
    """What is identified from rests of the commands.

    Attributes:
        settle_s: time behind a move until the devices stand.
        ring_down: the modes of free swings.
        body: mass and damping of the moving rod.
    """

    settle_s: float
    ring_down: bool
    body: bool


@dataclass(frozen=True, eq=False)
class IdentifiedAxis:
    """One axis: what its commands can show, and its answer, or the reason why there is none."""

    name: str
    unit: str
    per_unit: float
    excitation: Excitation
    answer: AxisAnswer | None
    refused: str


@dataclass(frozen=True, eq=False)
class IdentifiedMotion:
    """What recordings of one robot show.

    Attributes:
        robot: its name.
        recordings: they, in order.
        axes: of its devices.
        tip: the answer of a measured tip; None without one, then ``tip_refused`` has the reason.
        ring_downs: of the rests, where asked for, the pose with most of them first.
        body: mass and damping, where asked for.
    """

    robot: str
    recordings: tuple[RobotRecording, ...]
    axes: tuple[IdentifiedAxis, ...]
    tip: TipAnswer | None
    tip_refused: str
    ring_downs: tuple[RingDown, ...]
    body: BodyFit | None


def identify(
    name: str, robot: RobotDescription, recordings: Sequence[RobotRecording], rests: Rests | None
) -> IdentifiedMotion:
    """Identify one robot.

    Args:
        name: of the robot.
        robot: description of the robot file; its axes are those of the recordings.
        recordings: of it.
        rests: what to take from rests of the commands; None for nothing.

    Raises:
        ContidError: recordings of other axes, or ring-downs asked for and none there.
    """
    for each in recordings:
        if each.axes != robot.all_axis_names:
            raise ContidError(
                f"{each.name}: its axes are {', '.join(each.axes)}; those of {name} are "
                f"{', '.join(robot.all_axis_names)}"
            )
    # What was asked for and is not there ends the command before the long fits.
    ring_downs: tuple[RingDown, ...] = ()
    body = None
    if rests is not None:
        decays = [decays_of(each, rests.settle_s) for each in recordings]
        if rests.ring_down:
            ring_downs = fit_ring_downs([decay for own in decays for decay in own])
        if rests.body:
            body = fit_body(robot, recordings, decays)
    axes = []
    for k, (axis, quantity) in enumerate(zip(robot.all_axis_names, robot.quantities, strict=True)):
        traces = [each.axis_trace(k) for each in recordings if len(each.axis_at_s[k]) > 0]
        if not traces:
            empty = Excitation(0.0, 0.0, 0.0, float("inf"), float("inf"), 1.0, ())
            refused = "no measurement of it is recorded"
            axes.append(IdentifiedAxis(axis, quantity.unit, quantity.to_si(1.0), empty, None, refused))
            continue
        excitation = excitation_of(traces)
        found, refused = None, "; ".join(excitation.warnings)
        if excitation.upper_hz > 0.0:
            try:
                found = fit_axis(traces)
            except ContidError as error:
                refused = str(error)
        axes.append(IdentifiedAxis(axis, quantity.unit, quantity.to_si(1.0), excitation, found, refused))
    tip, tip_refused = None, ""
    measured = [each for each in recordings if len(each.tip_at_s) >= LEAST_TIPS]
    if not measured:
        tip_refused = "no measured tip is recorded: run it with a tracker"
    else:
        try:
            tip = fit_tip([each.tip_trace() for each in measured], _statics(robot, measured))
        except ContidError as error:
            tip_refused = str(error)
    return IdentifiedMotion(name, tuple(recordings), tuple(axes), tip, tip_refused, ring_downs, body)


def tip_motion(
    name: str,
    robot: RobotDescription,
    recordings: Sequence[RobotRecording],
    loads_kg: Sequence[float],
    source: str,
) -> TipMotion:
    """The tip in motion, from all recordings with a measured tip, beginning with the statics of the file.

    Args:
        name: of the robot.
        robot: description of the robot file.
        recordings: of it.
        loads_kg: payload of each; empty for none.
        source: origin of the numbers, for their file.

    Raises:
        ContidError: too few tips, or no axis moved.
    """
    model = build_model(robot)

    def statics(commands: Array) -> Array:
        try:
            return np.asarray(forward_many(model, commands)["tip_m"])
        except ContidError:
            return np.full((len(commands), 3), np.nan)

    loads = loads_kg or [0.0] * len(recordings)
    traces = [
        LoadedTrace(each.tip_trace(), load_kg)
        for each, load_kg in zip(recordings, loads, strict=True)
        if len(each.tip_at_s) >= LEAST_TIPS
    ]
    return fit_tip_motion(name, robot.axis_names, traces, statics, source)


def _statics(robot: RobotDescription, recordings: Sequence[RobotRecording]) -> list[Array] | None:
    """Tips of the commands by the model of the file, in the base frame; None where one has no pose."""
    model = build_model(robot)
    out = []
    for each in recordings:
        commands = each.sent[:, : len(robot.axis_names)]
        # Rests repeat a command; each is computed once.
        different, places = np.unique(commands, axis=0, return_inverse=True)
        try:
            tips = forward_many(model, different)["tip_m"]
        except ContidError:
            return None
        if not np.isfinite(tips).all():
            return None
        out.append(np.asarray(tips[places.ravel()]))
    return out
