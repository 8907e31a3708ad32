"""Names, axes and limits of the robots in a robot file, in the units of files or in SI."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from contid import kernels
from contid.api.arguments import ArgumentError
from contid.api.units import Units
from contid.html import html_table
from contid.kinematics.array import Array
from contid.kinematics.batch import Solutions
from contid.robot_file.findings import allowed_names
from contid.robot_file.load import LoadedFile, load_named
from contid.robot_file.robot import RobotDescription
from contid.targets import REACH

_SECTIONS: Final = (
    *(f"rack{rack}.length" for rack in (1, 2, 3)),
    *(f"s{section}.bend_radius" for section in range(1, 9)),
    REACH,
)
#: Limits of the models of contid beyond those of single axes, in the order of their bits.
OF_MODELS: Final[dict[str, tuple[str, ...]]] = {
    "rack_finger": ("arc_length.min", "curvature", "no_arc"),
    "tri_rack": _SECTIONS,
    "tri_tube": _SECTIONS,
    "cosserat": ("stability", REACH, "iterations"),
}
BITS: Final = 64


@dataclass(frozen=True, eq=False)
class AxisRanges:
    """Ranges and rates of the axes of a robot, in the units of the library.

    Attributes:
        names: names of the axes, with their unit as in trajectories: ``left_mm``.
        min, max: limits of every axis, shape ``(n,)``.
        rest: rest pose, shape ``(n,)``.
        velocity: maximum speed of an axis, per s.
        acceleration: greatest acceleration, in the axis unit per s^2.
        jerk: greatest jerk, in the axis unit per s^3.
    """

    names: tuple[str, ...]
    min: Array
    max: Array
    rest: Array
    velocity: float
    acceleration: float
    jerk: float


class LimitBits:
    """Bits for names of limits; names of other models join at the end."""

    def __init__(self, model: str, axes: Sequence[str]) -> None:
        own = [f"{axis}.{end}" for end in ("min", "max") for axis in axes]
        names = dict.fromkeys([*own, *OF_MODELS.get(model, ())])
        self._places = {name: place for place, name in enumerate(names)}

    @property
    def names(self) -> tuple[str, ...]:
        """Bit k stands for ``names[k]``."""
        return tuple(self._places)

    def translated(self, solutions: Solutions) -> NDArray[np.uint64]:
        """``limited_by`` of a batch, whose bits have an order of their own, in the order of `names`."""
        bits = solutions.rows["limited_by"]
        translated = np.zeros(len(bits), dtype=np.uint64)
        limited = np.flatnonzero(bits)
        for k, name in enumerate(solutions.limit_names):
            with_this_limit = limited[(bits[limited] >> np.uint64(k)) & np.uint64(1) != 0]
            if len(with_this_limit):
                place = self._places.setdefault(name, len(self._places))
                translated[with_this_limit] |= np.uint64(1 << min(place, BITS - 1))
        return translated

    def of(self, bits: int) -> tuple[str, ...]:
        """The names of the bits that are set."""
        return tuple(name for k, name in enumerate(self.names) if bits >> k & 1)


class DescribedRobots:
    """The robots of a file, of which one may be chosen; base of `contid.api.robot.Robot`."""

    def __init__(self, file: str | Path, *, si: bool = False) -> None:
        kernels.require()
        self.loaded: LoadedFile = load_named(str(file))
        self.units = Units(si)
        self._robots = {n: robot for n, robot in self.loaded.file.robots.items() if not robot.passive}
        self.names: tuple[str, ...] = tuple(self._robots)
        self._chosen: str | None = self.names[0] if len(self.names) == 1 else None

    def __getitem__(self, name: str) -> Self:
        """The robot of that name.

        Raises:
            ArgumentError: no robot of the file with actuators has that name.
        """
        if name not in self._robots:
            raise ArgumentError(
                f"{self.loaded.path.name}: no robot {name!r}; {allowed_names(self.names, name)}"
            )
        chosen = object.__new__(type(self))
        chosen.loaded, chosen.units, chosen._robots = self.loaded, self.units, self._robots
        chosen.names, chosen._chosen = (name,), name
        return chosen

    def __repr__(self) -> str:
        choice = f"[{self._chosen!r}]" if len(self._robots) > 1 and self._chosen else ""
        return f"Robot({str(self.loaded.path)!r}){choice}"

    def _repr_html_(self) -> str:
        return "".join(self[name]._limits_html() for name in self.names)

    def _limits_html(self) -> str:
        ranges, description = self.limits, self.description
        caption = f"{self.name}: {description.model} of {self.loaded.path.name}"
        if description.placeholder:
            caption += f", {len(description.placeholder)} placeholder values (contid check names them)"
        rows = zip(self.axes, *(each.tolist() for each in (ranges.min, ranges.max, ranges.rest)), strict=True)
        return html_table(caption, ("axis", "min", "max", "rest"), rows)

    @property
    def name(self) -> str:
        """Name of the robot in its file.

        Raises:
            ArgumentError: there are several; choose one.
        """
        if self._chosen is None:
            first = self.names[0] if self.names else "NAME"
            raise ArgumentError(
                f"{self.loaded.path.name} has {len(self.names)} robots: {', '.join(self.names)}; "
                f"choose one: robot[{first!r}]"
            )
        return self._chosen

    @property
    def description(self) -> RobotDescription:
        """The validated keys of the robot file."""
        return self._robots[self.name]

    @property
    def dimension(self) -> int:
        """2 for planar robots, whose positions have two columns, else 3."""
        return self.description.dimension

    @property
    def axes(self) -> tuple[str, ...]:
        """Columns of an actuation: ``left_mm``, ``s1.p1_bar``; without those of a wrist or gripper."""
        unit = self.units.name(self.description.quantity)
        return tuple(f"{axis}_{unit}" for axis in self.description.axis_names)

    @cached_property
    def limits(self) -> AxisRanges:
        """Ranges and rates of the axes."""
        robot, quantity = self.description, self.description.quantity

        def converted(*values: float) -> Array:
            return self.units.from_si(np.array(values, dtype=float), quantity)

        rest = robot.rest[: len(robot.axis_names)]  # without extra axes
        rates = converted(*(each[0] for each in robot.rate_limits))  # the same for all axes of the model
        return AxisRanges(
            self.axes, converted(*robot.lower), converted(*robot.upper), converted(*rest), *rates.tolist()
        )

    @property
    def limit_names(self) -> tuple[str, ...]:
        """Bit k of ``limited_by`` stands for ``limit_names[k]``."""
        return self._bits.names

    def limits_in(self, limited_by: int) -> tuple[str, ...]:
        """Names of the limits in a value of ``limited_by``: ``("s1.p1.max",)``."""
        return self._bits.of(int(limited_by))

    @cached_property
    def _bits(self) -> LimitBits:
        return LimitBits(self.description.model, self.description.axis_names)
