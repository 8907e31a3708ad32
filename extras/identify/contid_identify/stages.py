"""Everything that is identified from the recordings of one robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.kinematics.batch import forward_many
from contid.kinematics.model import build_model
from contid.kinematics.tendon.model import TendonModel
from contid.robot_file.base import Quantity
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.robot import RobotDescription
from contid_identify.answer import CommandedTrace
from contid_identify.body_fit import BodyFit, fit_body
from contid_identify.chambers.fit import arm_of, fit_chamber_motion
from contid_identify.chambers.motion import ChamberArm, ChamberMotion
from contid_identify.delay_lag import AxisAnswer, fit_axis
from contid_identify.excitation import Excitation, excitation_of
from contid_identify.recording import RobotRecording
from contid_identify.ring_down import RingDown, decays_of, fit_ring_downs
from contid_identify.sections.bent import ArmSections
from contid_identify.sections.fit import sections_of
from contid_identify.tip_answer import LEAST_TIPS, TipAnswer, fit_tip
from contid_identify.tip_fit.trace_rows import LoadedTrace
from contid_identify.tip_motion import TipMotion
from contid_identify.tip_motion_fit import fit_tip_motion


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
    """One axis: what its commands can show, and its answer, or the reason why there is none.

    Attributes:
        name: of the axis.
        unit: of the robot file.
        per_unit: what one of that unit is in the unit of ``excitation`` and ``answer`` [m, Pa or rad].
        excitation: of its commands; its warnings are there with an answer, too.
        answer: None when there is none.
        refused: why there is no answer; "" with one.
    """

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
        robot: description of the robot file; all its axes, those of the model and the extra ones, are those
            of the recordings.
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
    axes = [
        _identified_axis(axis, quantity, [e.axis_trace(k) for e in recordings if len(e.axis_at_s[k]) > 0])
        for k, (axis, quantity) in enumerate(zip(robot.all_axis_names, robot.quantities, strict=True))
    ]
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


def _identified_axis(name: str, quantity: Quantity, traces: Sequence[CommandedTrace]) -> IdentifiedAxis:
    """The answer of one axis to its commands, from the recordings that have measurements of it."""
    answer, refused = None, ""
    if not traces:
        excitation = Excitation.of_nothing(span=0.0, noise=0.0, warning="")
        refused = "no measurement of it is recorded"
    else:
        excitation = excitation_of(traces)
        if excitation.informative:
            try:
                answer = fit_axis(traces)
            except ContidError as error:
                refused = str(error)
        else:
            refused = "; ".join(excitation.warnings)
    return IdentifiedAxis(
        name=name,
        unit=quantity.unit,
        per_unit=quantity.to_si(1.0),
        excitation=excitation,
        answer=answer,
        refused=refused,
    )


def tip_motion(
    name: str,
    robot: RobotDescription,
    recordings: Sequence[RobotRecording],
    loads_kg: Sequence[float],
    source: str,
    form: str = "map",
    azimuths_rad: Sequence[float | None] = (),
) -> TipMotion | ChamberMotion:
    """The tip in motion, from all recordings with a measured tip, beginning with the statics of the file.

    Args:
        name: of the robot.
        robot: description of the robot file.
        recordings: of it.
        loads_kg: payload of each; empty for none.
        source: origin of the numbers, for their file.
        form: ``map``; ``bends`` of the sections of a tendon robot in front of the map; or ``arcs`` of
            chambers, which predict patterns that were not recorded.
        azimuths_rad: of the chambers, see `arm_of`; empty for those of the file.

    Raises:
        ContidError: too few tips, no axis moved, bends of another robot than one of tendons, or arcs of a
            robot without chambers or with payloads.
    """
    model = build_model(robot)

    def statics(commands: Array) -> Array:
        # A prior at drawn commands: the fit leaves out rows that are not finite.
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

    match arm_of_form(name, robot, loads, form, azimuths_rad):
        case ChamberArm() as arm:
            trace = [each.trace for each in traces]
            return fit_chamber_motion(name, robot.axis_names, arm, trace, source)
        case sections:
            return fit_tip_motion(name, robot.axis_names, traces, statics, source, sections)


def arm_of_form(
    name: str,
    robot: RobotDescription,
    loads_kg: Sequence[float],
    form: str,
    azimuths_rad: Sequence[float | None] = (),
) -> ArmSections | ChamberArm | None:
    """What a form of the tip's motion begins with; None for ``map``. For the arguments see `tip_motion`.

    Raises:
        ContidError: the form is not for this robot, these payloads or this number of azimuths.
    """
    if form == "bends":
        model = build_model(robot)
        if not isinstance(model, TendonModel):
            raise ContidError(f"{name}: bends of sections are for `model: tendon`; use `--form map`")
        return sections_of(model)
    if form != "arcs":
        return None
    if not isinstance(robot, Cosserat) or any(loads_kg):
        raise ContidError(f"{name}: arcs are for pneumatic arms without payloads; use `--form map`")
    return arm_of(robot, azimuths_rad)


def _statics(robot: RobotDescription, recordings: Sequence[RobotRecording]) -> list[Array] | None:
    """Tips of the commands by the model of the file, in the base frame; None where one has no pose.

    They are an input of the regression at every tick, so none may be missing. The axes of the model are the
    first ones of the commands; the extra axes do not move the tip.
    """
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
