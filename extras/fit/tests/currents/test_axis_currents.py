"""Currents of a finger from rows of sessions, without a run."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import cast

import pytest

from contid.control.tick.supervisor import Mode
from contid.robot_file.load import load_named
from contid.robot_file.rack_finger import RackFinger
from contid.session.read import Session
from contid_fit.sense.calibration import CalibrationError
from contid_fit.sense.usual_current import AxisCurrents, usual_currents


class Rows:
    """The part of a session that is read: rows, no events."""

    def __init__(self, path: str, rows: Sequence[Mapping[str, float]]) -> None:
        self.path = Path(path)
        self._rows = rows

    def __iter__(self) -> Iterator[Mapping[str, float]]:
        return iter(self._rows)

    def events(self) -> Iterator[object]:
        return iter(())


def row(t_s: float, currents_a: Mapping[str, float], mode: Mode = Mode.RUN) -> dict[str, float]:
    """A tick whose commands grow with time."""
    values = {"t_s": t_s, "tick.finger.mode": float(mode)}
    for axis, current_a in currents_a.items():
        values[f"command.finger.device.{axis}_rad"] = t_s
        values[f"sample.finger.{axis}.effort"] = current_a
        values[f"sample.finger.{axis}.valid"] = 1.0
    return values


def currents(*sessions: Rows) -> list[AxisCurrents]:
    finger = load_named("finger").file.robots["finger"]
    assert isinstance(finger, RackFinger)
    return usual_currents(cast(list[Session], sessions), "finger", finger)


def test_the_first_of_the_greatest_currents_has_its_time_and_file() -> None:
    rows = [row(float(k), {"left": (0.05, -0.07, math.nan, 0.07)[k % 4], "right": 0.02}) for k in range(8)]
    rows.append(row(8.0, {"left": 0.5, "right": 0.5}, Mode.OFF))
    left, right = currents(Rows("a.mcap", rows), Rows("b.mcap", rows))
    assert (left.axis, left.samples, left.moving_s, left.greatest_a) == ("finger.left", 12, 16.0, 0.07)
    assert (left.at_s, left.file, left.usually_a) == (1.0, "a.mcap", 0.07)
    assert (right.greatest_a, right.at_s, right.file) == (0.02, 0.0, "a.mcap")


def test_a_session_of_a_finger_with_other_axes_is_refused() -> None:
    rows = [row(float(k), {"left": 0.05, "middle": 0.05}) for k in range(8)]
    with pytest.raises(CalibrationError, match=r"b\.mcap: no robot 'finger' with an axis 'right'"):
        currents(Rows("b.mcap", rows))
