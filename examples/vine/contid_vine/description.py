"""Robot description of the vine: it grows from its base and one tendon bends it, in a plane."""

from __future__ import annotations

from typing import ClassVar, Literal

from contid.robot_file.base import Interval, LengthInterval, Quantity, Size, Strict
from contid.robot_file.robot import RobotDescription
from contid.targets import Actuation
from contid.units import MM_PER_M


class VineGeometry(Strict):
    """Dimensions of the vine.

    Attributes:
        tendon_mm: distance of the tendon from the backbone.
    """

    tendon_mm: Size


class VineLimits(Strict):
    """Limits of the vine.

    Attributes:
        feed_mm: ``[min, max]`` length that is grown.
        pull_mm: ``[min, max]`` pull of the tendon.
    """

    feed_mm: LengthInterval
    pull_mm: Interval


class Vine(RobotDescription):
    """A planar vine; it grows along +y and bends to +x when the tendon is pulled.

    Axes: ``feed`` and ``pull``. Targets: ``x_mm``, ``y_mm``.

    Attributes:
        model: ``vine``.
        geometry: dimensions.
        limits: of feed and pull.
    """

    quantity: ClassVar[Quantity] = Quantity.LENGTH
    dimension: ClassVar[int] = 2

    model: Literal["vine"]
    geometry: VineGeometry
    limits: VineLimits

    @property
    def axis_names(self) -> tuple[str, ...]:
        """The length that is grown, then the pull of the tendon."""
        return ("feed", "pull")

    @property
    def lower(self) -> Actuation:
        """Minimum values [m]."""
        return (self.limits.feed_mm[0] / MM_PER_M, self.limits.pull_mm[0] / MM_PER_M)

    @property
    def upper(self) -> Actuation:
        """Maximum values [m]."""
        return (self.limits.feed_mm[1] / MM_PER_M, self.limits.pull_mm[1] / MM_PER_M)
