"""Robot description of a closed chain: two arms on their bases and the rope between their tips."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar, Literal

from pydantic import Field, model_validator

from contid.errors import Located
from contid.robot_file.base import Positive, Quantity, Strict
from contid.robot_file.findings import allowed_names
from contid.robot_file.positions import Document, KeyPath
from contid.robot_file.rates import Rates
from contid.robot_file.robot import RobotDescription
from contid.targets import Actuation
from contid.units import MM_PER_M


class RopeDescription(Strict):
    """A rope between the tips of two arms.

    Attributes:
        length_mm: between its two ends.
        mass_g: mass of that length; gives the force on the tips. Without it that force is not computed.
        ends: ``pinned``: free to turn at the tips; a catenary. ``clamped``: tangent to the directions of the
            two tips.
        pieces: number of pieces of its curve: one, or two joined at the middle of the catenary, which a
            clamped rope with level ends needs.
    """

    length_mm: Positive
    mass_g: Positive | None = None
    ends: Literal["pinned", "clamped"] = "pinned"
    pieces: Literal[1, 2] = 1


class ChainLink(Strict):
    """One link: an arm or a rope.

    Attributes:
        arm: name of a robot of this file.
        rope: a rope between the arms before and after it.
    """

    arm: str | None = None
    rope: RopeDescription | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> ChainLink:
        if (self.arm is None) == (self.rope is None):
            raise ValueError("a link is either an arm or a rope; write arm: ROBOT or rope: {length_mm: ...}")
        return self


class Chain(RobotDescription):
    """Two arms and a rope, closed through the ground: no actuators of its own, constraints on its arms.

    Where the rope would be too short or below the floor, a trajectory is refused, a row of a live stream
    holds the arms, and no approach, move or path to a rest pose begins. A fault of one arm stops the other
    by its own ``stop.on_fault``; an order that stops one arm holds the other. Gravity is along -z of the
    world.

    Attributes:
        model: ``chain``.
        links: an arm, a rope, an arm.
        floor_mm: minimum height of the rope in the world.
    """

    quantity: ClassVar[Quantity] = Quantity.LENGTH
    dimension: ClassVar[int] = 3

    model: Literal["chain"]
    links: tuple[ChainLink, ...] = Field(min_length=3, max_length=3)
    floor_mm: float
    rates: Rates = Rates()

    @model_validator(mode="after")
    def _closed(self) -> Chain:
        kinds = ["rope" if link.arm is None else "arm" for link in self.links]
        if kinds != ["arm", "rope", "arm"]:
            raise ValueError(f"links are {', '.join(kinds)}; allowed: arm, rope, arm")
        return self

    @property
    def arms(self) -> tuple[str, str]:
        """Names of the two arms."""
        return str(self.links[0].arm), str(self.links[2].arm)

    @property
    def rope(self) -> RopeDescription:
        """The rope between them."""
        rope = self.links[1].rope
        assert rope is not None
        return rope

    @property
    def floor_m(self) -> float:
        """Minimum height of the rope [m]."""
        return self.floor_mm / MM_PER_M

    @property
    def passive(self) -> bool:
        """A chain has no actuators."""
        return True

    @property
    def axis_names(self) -> tuple[str, ...]:
        """No axes of its own."""
        return ()

    @property
    def accepts(self) -> frozenset[str]:
        """It takes no targets."""
        return frozenset()

    @property
    def lower(self) -> Actuation:
        """Empty: no axes."""
        return ()

    @property
    def upper(self) -> Actuation:
        """Empty: no axes."""
        return ()


def check_chain(
    document: Document,
    at: KeyPath,
    chain: Chain,
    robots: Mapping[str, RobotDescription | None],
) -> Iterator[Located]:
    """Findings unless its arms are two different spatial robots of the file.

    Args:
        document: the robot file.
        at: path of the chain in it.
        chain: chain to check.
        robots: robots of the file, None for one with mistakes.
    """
    movable = [name for name, robot in robots.items() if robot is None or not robot.passive]
    for index, name in ((0, chain.arms[0]), (2, chain.arms[1])):
        place = (*at, "links", index, "arm")
        robot = robots.get(name)
        if name not in robots:
            message = f"arm: no robot {name!r}; {allowed_names(movable, name)}"
            yield document.at_value(place, message)
        elif robot is not None and robot.passive:
            message = f"arm: {name!r} has no actuators; {allowed_names(movable, name)}"
            yield document.at_value(place, message)
        elif robot is not None and robot.dimension != 3:
            yield document.at_value(place, f"arm: {name!r} is planar; a rope needs spatial arms")
    if chain.arms[0] == chain.arms[1]:
        message = f"arm: {chain.arms[1]!r} is the first arm already; a chain closes between two"
        yield document.at_value((*at, "links", 2, "arm"), message)
