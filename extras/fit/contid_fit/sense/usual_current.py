"""The greatest current of a finger that moves without a contact, from recorded sessions."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
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
        greatest_a: absolute current [A].
        usually_a: 999 of 1000 are not greater [A].
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
        CalibrationError: a session has a contact or no currents, or an axis moved too little.
    """
    axes = robot.axis_names
    currents: list[list[float]] = [[] for _ in axes]
    places: list[list[tuple[float, str]]] = [[] for _ in axes]
    moving_s = [0.0] * len(axes)
    for session in sessions:
        _refuse_contacts(session, name)
        before = [math.nan] * len(axes)
        last_s = math.nan
        seen = [0] * len(axes)
        for row in session:
            if f"tick.{name}.mode" not in row:
                raise CalibrationError(f"{session.path}: no robot {name!r}")
            t_s = row["t_s"]
            for k, axis in enumerate(axes):
                command = row[f"command.{name}.device.{axis}_rad"]
                if command != before[k] and not math.isnan(command + before[k] + last_s):
                    moving_s[k] += t_s - last_s
                before[k] = command
                current = row[f"sample.{name}.{axis}.effort"]
                valid = row[f"sample.{name}.{axis}.valid"] == 1.0 and not math.isnan(current)
                if valid and row[f"tick.{name}.mode"] in _WATCHED:
                    seen[k] += 1
                    currents[k].append(abs(current))
                    places[k].append((t_s, str(session.path)))
            last_s = t_s
        for axis, count in zip(axes, seen, strict=True):
            if not count:
                message = f"no current of {name}.{axis}: its devices report none, or it was not armed"
                raise CalibrationError(f"{session.path}: {message}")
    out = []
    for k, axis in enumerate(axes):
        if moving_s[k] < MIN_MOVING_S:
            message = f"{name}.{axis} moves for {moving_s[k]:.1f} s, {MIN_MOVING_S:g} s are needed"
            raise CalibrationError(f"{message}: record motions as they are used, over the whole reach")
        values = np.array(currents[k])
        largest = int(values.argmax())
        out.append(
            AxisCurrents(
                axis=f"{name}.{axis}",
                samples=len(values),
                moving_s=moving_s[k],
                greatest_a=float(values[largest]),
                usually_a=float(np.quantile(values, 0.999)),
                at_s=places[k][largest][0],
                file=places[k][largest][1],
            )
        )
    return out


def usual_ma(found: Iterable[AxisCurrents], margin: float) -> int:
    """The key of the robot file [mA]: the greatest current and a share more, rounded up."""
    greatest_ma = 1e3 * max(each.greatest_a for each in found)
    return _STEP_MA * math.ceil(greatest_ma * (1.0 + margin) / _STEP_MA)


def _refuse_contacts(session: Session, name: str) -> None:
    for event in session.events():
        if isinstance(event, ContactBegan | SqueezeChanged) and event.robot == name:
            message = f"tick {event.tick}: {event.message}; record a session without contact"
            raise CalibrationError(f"{session.path}: {message}")
