"""The greatest current of a finger that moves without a contact, from recorded sessions."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from contid.control.engine.events.robots import ContactBegan, SqueezeChanged
from contid.control.tick.supervisor import Mode
from contid.robot_file.load import LoadedFile
from contid.robot_file.rack_finger import RackFinger
from contid.session.read import Session
from contid_fit.sense.calibration import CalibrationError
from contid_fit.sense.chosen_robot import chosen_robot

#: Every axis must move for at least this time [s].
MIN_MOVING_S: Final = 5.0
#: Modes in which a contact is looked for: those of a robot that may move, and stands under torque.
_WATCHED: Final = (Mode.APPROACH, Mode.RUN, Mode.HOLD, Mode.STOPPING)
#: A current for the robot file is rounded up to a multiple of this [mA].
_STEP_MA: Final = 5


@dataclass(frozen=True, slots=True)
class AxisCurrents:
    """Currents of one axis, over all sessions.

    Attributes:
        axis: ROBOT.AXIS.
        samples: number of measured currents.
        moving_s: time in which its command changed [s].
        greatest_a: greatest absolute current [A].
        usually_a: absolute current that 999 of 1000 do not exceed [A].
        at_s: time of the greatest in its session [s].
        file: path of that session.
    """

    axis: str
    samples: int
    moving_s: float
    greatest_a: float
    usually_a: float
    at_s: float
    file: str


def finger_of(loaded: LoadedFile, name: str | None) -> tuple[str, RackFinger]:
    """The finger whose currents are looked at.

    Raises:
        CalibrationError: there is none, or no such one, or a choice is needed.
    """
    without = "contacts by currents are found for model rack_finger only"
    return chosen_robot(loaded, name, RackFinger, "finger", without)


def usual_currents(sessions: Iterable[Session], name: str, robot: RackFinger) -> list[AxisCurrents]:
    """Currents of every axis of a finger, over sessions in which it touched nothing.

    Raises:
        CalibrationError: a session has a contact, no such finger or no currents, or an axis moved too little.
    """
    found = [_Currents(axis) for axis in robot.axis_names]
    for session in sessions:
        _refuse_contacts(session, name)
        _add_session(found, session, name)
    for each in found:
        if each.moving_s < MIN_MOVING_S:
            message = f"{name}.{each.axis} moves for {each.moving_s:.1f} s, {MIN_MOVING_S:g} s are needed"
            raise CalibrationError(f"{message}: record motions as they are used, over the whole reach")
    return [
        AxisCurrents(
            axis=f"{name}.{each.axis}",
            samples=len(each.absolute_a),
            moving_s=each.moving_s,
            greatest_a=each.greatest_a,
            usually_a=float(np.quantile(np.array(each.absolute_a), 0.999)),
            at_s=each.at_s,
            file=each.file,
        )
        for each in found
    ]


@dataclass(slots=True)
class _Currents:
    """What was read of one axis so far; attributes as those of `AxisCurrents`."""

    axis: str
    absolute_a: list[float] = field(default_factory=list)
    moving_s: float = 0.0
    greatest_a: float = -1.0
    at_s: float = 0.0
    file: str = ""


def _add_session(found: list[_Currents], session: Session, name: str) -> None:
    """Add the currents of a session, while the robot was under torque, and the times of motion.

    Raises:
        CalibrationError: it has no such finger, or no current of an axis.
    """
    commands = [math.nan] * len(found)
    last_s = math.nan
    seen = [len(each.absolute_a) for each in found]
    for row in session:
        t_s = row["t_s"]
        for k, each in enumerate(found):
            column = f"command.{name}.device.{each.axis}_rad"
            if column not in row:
                raise CalibrationError(f"{session.path}: no robot {name!r} with an axis {each.axis!r}")
            if row[column] != commands[k] and not math.isnan(row[column] + commands[k] + last_s):
                each.moving_s += t_s - last_s
            commands[k] = row[column]
            current_a = abs(row[f"sample.{name}.{each.axis}.effort"])
            valid = row[f"sample.{name}.{each.axis}.valid"] == 1.0 and not math.isnan(current_a)
            if valid and row[f"tick.{name}.mode"] in _WATCHED:
                each.absolute_a.append(current_a)
                if current_a > each.greatest_a:
                    each.greatest_a, each.at_s, each.file = current_a, t_s, str(session.path)
        last_s = t_s
    for each, before in zip(found, seen, strict=True):
        if len(each.absolute_a) == before:
            message = f"no current of {name}.{each.axis}: its devices report none, or it was not armed"
            raise CalibrationError(f"{session.path}: {message}")


def usual_ma(found: Iterable[AxisCurrents], margin: float) -> int:
    """``sense.usual_ma`` of the robot file [mA]: the greatest current times ``1 + margin``, rounded up."""
    greatest_ma = 1e3 * max(each.greatest_a for each in found)
    return _STEP_MA * math.ceil(greatest_ma * (1.0 + margin) / _STEP_MA)


def _refuse_contacts(session: Session, name: str) -> None:
    """Refuse a session in which the finger met or held something.

    Raises:
        CalibrationError: it did.
    """
    for event in session.events():
        if isinstance(event, ContactBegan | SqueezeChanged) and event.robot == name:
            message = f"tick {event.tick}: {event.message}; record a session without contact"
            raise CalibrationError(f"{session.path}: {message}")
