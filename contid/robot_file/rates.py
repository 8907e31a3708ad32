"""Rates of a robot's axes, and input shaping: how fast commands change, and how they go out in parts."""

from __future__ import annotations

import cmath
import enum
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Final, Literal, NamedTuple

from pydantic import Field, model_validator

from contid.robot_file.base import NonNegative, Positive, Rate, Strict
from contid.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from contid.errors import Located
    from contid.robot_file.positions import Document
    from contid.robot_file.robot import RobotDescription

#: Least stiffness of a mode, over mass, under a load that would make it buckle; a share of that without.
LEAST_STIFFNESS: Final = 0.05
#: Frequencies that shaping takes [Hz].
LOWEST_HZ: Final = 0.5
HIGHEST_HZ: Final = 100.0
_GRAMS = 1e3 / STANDARD_GRAVITY

Frequency = Annotated[float, Field(ge=LOWEST_HZ, le=HIGHEST_HZ)]


class ShapeKind(enum.StrEnum):
    """Which vibration is cancelled: ``zv`` that of the stated frequency, ``zvd`` also that of ones nearby.

    With a schedule ``zvd`` cancels that of the two slowest modes, which are near each other.
    """

    ZV = "zv"
    ZVD = "zvd"


class ShapeSchedule(Strict):
    """Frequencies of the two slowest modes over pose and load, written by `contid modes --schedule`.

    Polynomials of degree two in x, the distance of every axis from ``middle`` as a share of ``half``, held
    within 1: a number, one per axis, then one per pair of axes in order, (1, 1), (1, 2) .. (2, 2) ...

    Attributes:
        middle, half: middle and half of the range of every axis, in the unit of the file.
        least_hz, most_hz: range of the frequencies.
        first, second: polynomials of the first and second frequency, without a load.
        polynomials: what they are of: the logarithm of the frequency [Hz], or the squared period [s2], which
            grows with the squares of bends.
        load_g: mass for which the next two hold; greater ones count as this one.
        first_loaded, second_loaded: polynomials of f0^2 / f^2 - 1 under that mass; in between they grow with
            it. Without them a load does not count.
        payload_g: mass on the tip of targets without a load, besides that of ``dynamics``.
    """

    middle: tuple[float, ...]
    half: tuple[Positive, ...]
    least_hz: Frequency
    most_hz: Frequency
    first: tuple[float, ...]
    second: tuple[float, ...]
    load_g: Positive = 1.0
    first_loaded: tuple[float, ...] = ()
    second_loaded: tuple[float, ...] = ()
    payload_g: NonNegative = 0.0
    polynomials: Literal["log", "squared_period"] = "log"

    @model_validator(mode="after")
    def _counts(self) -> ShapeSchedule:
        axes = len(self.middle)
        count = 1 + axes + axes * (axes + 1) // 2
        if len(self.half) != axes:
            raise ValueError(f"half has {len(self.half)} numbers; allowed: {axes}, one per axis of middle")
        for key in ("first", "second", "first_loaded", "second_loaded"):
            found = len(getattr(self, key))
            if found != count and not (found == 0 and key.endswith("_loaded")):
                raise ValueError(f"{key} has {found} numbers; allowed: {count}, for {axes} axes")
        if self.most_hz < self.least_hz:
            raise ValueError(f"most_hz {self.most_hz:g} is less than least_hz {self.least_hz:g}")
        return self

    def frequencies(self, values: Sequence[float], load_n: float = 0.0) -> tuple[float, float]:
        """The two slowest frequencies [Hz] at a pose.

        Args:
            values: of every axis, in the unit of the file.
            load_n: known force on the tip, which counts as the weight of a mass; 0 takes ``payload_g``.
        """
        x = [
            min(1.0, max(-1.0, (value - middle) / half))
            for value, middle, half in zip(values, self.middle, self.half, strict=True)
        ]
        terms = [1.0, *x, *(a * b for i, a in enumerate(x) for b in x[i:])]
        share = min(1.0, (load_n * _GRAMS if load_n else self.payload_g) / self.load_g)
        return (
            self._frequency(terms, self.first, self.first_loaded, share),
            self._frequency(terms, self.second, self.second_loaded, share),
        )

    def scaled(self, share: float) -> ShapeSchedule:
        """Of a body whose frequencies are a share of these."""

        def scaled(own: Sequence[float]) -> tuple[float, ...]:
            if self.polynomials == "log":
                return (own[0] + math.log(share), *own[1:])
            return tuple(each / share**2 for each in own)

        return self.model_copy(
            update={
                "least_hz": min(HIGHEST_HZ, max(LOWEST_HZ, self.least_hz * share)),
                "most_hz": min(HIGHEST_HZ, max(LOWEST_HZ, self.most_hz * share)),
                "first": scaled(self.first),
                "second": scaled(self.second),
            }
        )

    def _frequency(
        self, terms: Sequence[float], own: Sequence[float], loaded: Sequence[float], share: float
    ) -> float:
        value = sum(a * b for a, b in zip(own, terms, strict=True))
        if self.polynomials == "log":
            low, high = math.log(self.least_hz), math.log(self.most_hz)
            found = math.exp(min(high, max(low, value)))
        else:
            found = min(max(value, self.most_hz**-2), self.least_hz**-2) ** -0.5
        if loaded and share:
            slower = sum(a * b for a, b in zip(loaded, terms, strict=True))
            found /= math.sqrt(max(LEAST_STIFFNESS, 1.0 + share * slower))
        return min(self.most_hz, max(self.least_hz, found))


class Impulse(NamedTuple):
    """A part of a command: when it goes out [s], and its size beside the first, which is 1."""

    after_s: float
    size: float


class InputShape(Strict):
    """Input shaping: a command goes out in parts, so that the swings that they start cancel.

    Motions and stops end later: by half a period of the frequency with ``zv``, by a period with ``zvd``;
    an emergency stop is not shaped. On a bent path the devices cut corners.

    Attributes:
        kind: ``zvd``, which bears an error of the frequency, or ``zv``, which takes half as long.
        frequency_hz: damped frequency of the body, from `contid modes` or a shake that was recorded.
        damping_ratio: of that mode; modes of a schedule have it in proportion to their frequency.
        schedule: frequencies over pose and load, chosen when a motion begins from rest: for where it goes,
            where that is known. One frequency for all poses when left out.
    """

    kind: ShapeKind = ShapeKind.ZVD
    frequency_hz: Frequency
    damping_ratio: Annotated[float, Field(ge=0, le=0.9)] = 0.0
    schedule: ShapeSchedule | None = None

    def impulses(self, frequencies: tuple[float, float] | None = None) -> list[Impulse]:
        """Parts of a command, for the two slowest frequencies [Hz] of a schedule, or for that of the file."""
        if frequencies is None:
            root = math.sqrt(1.0 - self.damping_ratio**2)
            k = math.exp(-self.damping_ratio * math.pi / root)
            sizes = (1.0, k) if self.kind is ShapeKind.ZV else (1.0, 2.0 * k, k * k)
            return [Impulse(number * 0.5 / self.frequency_hz, size) for number, size in enumerate(sizes)]
        first, *others = [self._pair(each) for each in frequencies]
        second = [Impulse(0.0, 1.0)] if self.kind is ShapeKind.ZV else others[0]
        return [Impulse(a.after_s + b.after_s, a.size * b.size) for a in first for b in second]

    def later_s(self) -> tuple[float, float]:
        """How much later motions end at least and at most [s]."""
        halves = 0.5 if self.kind is ShapeKind.ZV else 1.0
        if self.schedule is None:
            return (halves / self.frequency_hz,) * 2
        return (halves / self.schedule.most_hz, halves / self.schedule.least_hz)

    def swing_left(self, off: float) -> float:
        """Share of a swing that is left where the frequency of the body is ``off`` times the stated one."""
        rate = 2.0 * math.pi * self.frequency_hz * off
        ratio = self.damping_ratio
        growth = complex(ratio / math.sqrt(1.0 - ratio * ratio), 1.0) * rate
        parts = self.impulses()
        last_s, whole = parts[-1].after_s, sum(part.size for part in parts)
        return abs(sum(part.size * cmath.exp(growth * (part.after_s - last_s)) for part in parts)) / whole

    def _pair(self, frequency_hz: float) -> list[Impulse]:
        ratio = min(0.9, self.damping_ratio * frequency_hz / self.frequency_hz)
        k = math.exp(-ratio * math.pi / math.sqrt(1.0 - ratio * ratio))
        return [Impulse(0.0, 1.0), Impulse(0.5 / frequency_hz, k)]


class Rates(Strict):
    """Rate limits per axis, applied to successive commands.

    Attributes:
        velocity_mm_s, acceleration_mm_s2, jerk_mm_s3: needed by robots whose axes are lengths.
        velocity_bar_s, acceleration_bar_s2, jerk_bar_s3: needed by robots whose axes are pressures.
        velocity_deg_s, acceleration_deg_s2, jerk_deg_s3: needed beside them for axes of ``extra_deg``.
        shape: input shaping of what goes to the devices; off when left out.
    """

    velocity_mm_s: Rate | None = None
    acceleration_mm_s2: Rate | None = None
    jerk_mm_s3: Rate | None = None
    velocity_bar_s: Rate | None = None
    acceleration_bar_s2: Rate | None = None
    jerk_bar_s3: Rate | None = None
    velocity_deg_s: Rate | None = None
    acceleration_deg_s2: Rate | None = None
    jerk_deg_s3: Rate | None = None
    shape: InputShape | None = None


def check_shapes(
    document: Document, clearance: bool, robots: Mapping[str, RobotDescription | None]
) -> Iterator[Located]:
    """Findings where input shaping does not fit a robot, or leads it off the way that is checked for others.

    Args:
        document: the robot file.
        clearance: the file has ``clearance``.
        robots: robots of the file, None for one with mistakes.
    """
    known = {name: robot for name, robot in robots.items() if robot is not None}
    chained = any(robot.passive for robot in known.values())
    what = "a rope" if chained else "clearance"
    for name, robot in known.items():
        shape, at = robot.rates.shape, ("robots", name, "rates", "shape")
        if robot.passive or shape is None:
            continue
        if clearance or chained:
            yield document.at_key(
                at,
                f"shape: what goes out is a mean of commands, off the way that is checked for {what}; leave "
                "one of the two out",
            )
        if shape.schedule is not None and len(shape.schedule.middle) != len(robot.axis_names):
            yield document.at_key(
                (*at, "schedule"),
                f"schedule: it is for {len(shape.schedule.middle)} axes, and this robot has "
                f"{len(robot.axis_names)}; write it again with contid modes --schedule",
            )
