"""Targets of one step as a caller gives them: columns of a trajectory, or actuations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from contid.api.arguments import MAX_NUMBER, ArgumentError, as_rows
from contid.api.units import Units
from contid.errors import BadInputError
from contid.robot_file.findings import allowed_names
from contid.robot_file.robot import RobotDescription
from contid.targets import Target
from contid.trajectory.rows import RowReader

#: Columns of a trajectory with their values, actuations by robot, or the actuation of the only robot.
Command: TypeAlias = Mapping[str, ArrayLike] | ArrayLike

_NUMBERS: Final = frozenset({float, int, np.float64})


class CommandReader:
    """Turns commands into targets by robot in the world frame."""

    def __init__(self, robots: Mapping[str, RobotDescription], units: Units) -> None:
        self._robots = robots
        self._units = units
        self._readers: dict[tuple[str, ...], RowReader] = {}

    def targets(self, command: Command) -> Mapping[str, Target]:
        """Targets of the robots that a command names.

        Raises:
            ArgumentError: unknown columns or robots, a wrong shape, not finite.
        """
        if not isinstance(command, Mapping):
            if len(self._robots) != 1:
                names = ", ".join(self._robots)
                raise ArgumentError(f"several robots: name them, {{robot: actuation}} with {names}")
            return {name: self._actuation(name, command) for name in self._robots}
        if any(name in self._robots or _is_array(values) for name, values in command.items()):
            return {name: self._actuation(name, values) for name, values in command.items()}
        return self._row(command)

    def _actuation(self, name: str, values: ArrayLike) -> Target:
        robot = self._robots.get(name)
        if robot is None:
            raise ArgumentError(f"no robot {name!r}; {allowed_names(self._robots, name)}")
        if isinstance(values, np.ndarray) and values.dtype == np.float64:
            values = values.tolist()
        if isinstance(values, list | tuple) and len(values) == len(robot.axis_names):
            given: Sequence[Any] = values
            if _NUMBERS.issuperset(map(type, given)) and all(map(MAX_NUMBER.__ge__, map(abs, given))):
                # The usual step of a script: arrays of a few numbers cost ten times as much.
                to_si = float if self._units.si else robot.quantity.to_si
                return Target(actuation=tuple([to_si(float(value)) for value in given]))
        unit = self._units.name(robot.quantity)
        what = "actuation" if len(self._robots) == 1 else f"actuation of {name}"
        rows, shape = as_rows(what, values, [f"{axis}_{unit}" for axis in robot.axis_names])
        if shape != ():
            raise ArgumentError(f"{what} has shape {np.shape(values)}; a step takes one row")
        return Target(actuation=tuple(self._units.to_si(rows, robot.quantity)[0].tolist()))

    def _row(self, command: Mapping[str, ArrayLike]) -> Mapping[str, Target]:
        names = tuple(map(str, command))
        if not names:
            raise ArgumentError(f"no robot and no column; {allowed_names(self._robots)}")
        try:
            if names not in self._readers:
                self._readers[names] = RowReader(",".join(names), "command", self._robots)
            reader = self._readers[names]
            return reader.layout.targets(reader.row(_numbers(command), 1))
        except BadInputError as error:
            raise ArgumentError("; ".join(finding.message for finding in error.findings)) from None


def _is_array(values: ArrayLike) -> bool:
    """It has a dimension; lists of unequal length are arrays too, which are refused."""
    try:
        return np.ndim(values) > 0
    except ValueError:
        return True


def _numbers(command: Mapping[str, ArrayLike]) -> Sequence[float]:
    numbers = []
    for name, value in command.items():
        try:
            numbers.append(float(value))  # type: ignore[arg-type]  # what is no number is refused here
        except OverflowError:
            raise ArgumentError(f"{name}: the number is too large; at most {MAX_NUMBER:g}") from None
        except (TypeError, ValueError):
            raise ArgumentError(f"{name}: {value!r} is not a number") from None
    return numbers
