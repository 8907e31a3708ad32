"""Robot description of the two-rack finger (Morita et al.): a planar arc between two racks."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

from pydantic import model_validator

from contid.robot_file.base import (
    ContactPolicy,
    Interval,
    LengthInterval,
    NonNegative,
    Positive,
    Quantity,
    Size,
    Strict,
)
from contid.robot_file.clearance import PlaneDescription
from contid.robot_file.robot import RobotDescription, SectionLength
from contid.targets import Actuation
from contid.units import MM_PER_M


class LinkGeometry(Strict):
    """One rigid link of the chain inside the finger; only its curvature limit matters (Morita et al., Eq. 9).

    The paper uses one w for the width of a link and for the distance of the racks; here these are two keys.

    Attributes:
        length_mm: length of one link, along the finger.
        width_mm: width of one link, across the finger in its plane.
        gap_mm: between neighbouring links when the finger is straight.
    """

    length_mm: Size
    width_mm: Size
    gap_mm: NonNegative

    @property
    def curvature_max_per_m(self) -> float:
        """Curvature at which neighbouring links touch [1/m]: ``2 l / ((l + t) sqrt(l^2 + w^2))``.

        Equal to Eq. 9 of the paper, whose trigonometric functions cancel.
        """
        length, width, gap = (v / MM_PER_M for v in (self.length_mm, self.width_mm, self.gap_mm))
        return 2.0 * length / ((length + gap) * math.hypot(length, width))


class RackFingerGeometry(Strict):
    """Dimensions of the finger.

    Attributes:
        rack_spacing_mm: distance between the two racks.
        tip_length_mm: rigid tip body, straight on from the end of the arc.
        link: one link of the chain between the racks.
    """

    rack_spacing_mm: Size
    tip_length_mm: NonNegative
    link: LinkGeometry


class RackFingerLimits(Strict):
    """Limits of the racks and of the curvature (Morita et al., Eq. 8, for both bending signs).

    Attributes:
        length_mm: ``[min, max]`` length of a rack between base and tip body.
        curvature_max_per_mm: maximum curvature to either side; that of the links (Eq. 9) by default.
        arc_length_min_mm: minimum arc; near zero the curvature is ill-conditioned.
    """

    length_mm: LengthInterval
    curvature_max_per_mm: Positive | None = None
    arc_length_min_mm: Positive = 1.0

    @model_validator(mode="after")
    def _leaves_arcs(self) -> RackFingerLimits:
        if not self.arc_length_min_mm < self.length_mm[1]:
            raise ValueError(
                f"arc_length_min_mm {self.arc_length_min_mm:g} leaves no arc; allowed: less than the "
                f"greatest length of a rack, {self.length_mm[1]:g}"
            )
        return self


class CurvatureCorrection(Strict):
    """Measured curvature against commanded: ``k = k_d (1 + a S + b)``, S in mm (Eq. 5, 10, 11).

    Attributes:
        a_per_mm: slope a of the correction over the arc length S.
        b: its value at S = 0.
        arc_length_mm: range of S in which a and b were identified; outside it S is clamped.
    """

    a_per_mm: float
    b: float
    arc_length_mm: Interval

    def gain(self, arc_length_mm: float) -> float:
        """Measured curvature over commanded at an arc length."""
        low, high = self.arc_length_mm
        return 1.0 + self.a_per_mm * min(max(arc_length_mm, low), high) + self.b

    @model_validator(mode="after")
    def _keeps_sense_of_bending(self) -> CurvatureCorrection:
        for arc_length_mm in self.arc_length_mm:
            gain = self.gain(arc_length_mm)
            if not gain > 0.0:
                raise ValueError(
                    f"1 + a S + b is {gain:g} at S = {arc_length_mm:g} mm; it must stay above 0, "
                    "or the finger bends to the wrong side"
                )
        return self


class CurrentSense(Strict):
    """Contacts of a finger, from the currents that its servos report.

    Attributes:
        contact: reaction to a contact.
        usual_ma: greatest current of an axis that moves without a contact, with its friction.
        contact_ma: a current of this much more is a contact within 40 ms; one of less than half of it, never.
        nm_per_a: torque of an axis per its current, for moves until a force; 0.35 for an XL330-M288.
    """

    contact: ContactPolicy
    usual_ma: Positive
    contact_ma: Positive
    nm_per_a: Positive | None = None


class SimulatedObject(PlaneDescription):
    """A flat elastic object without friction; it meets the tip only.

    Attributes:
        point_mm: a point on its surface, in the world.
        normal: direction out of it, of any length.
        stiffness_n_per_mm: stiffness of the object.
        until_s: when it is taken away, after the bus was first opened; never when left out.
    """

    stiffness_n_per_mm: Positive
    until_s: Positive | None = None


class SimulatedFinger(Strict):
    """What ``--mock`` and ``driver: sim`` simulate beside the servos; real ones ignore it.

    Attributes:
        object: that the tip meets.
        friction_ma: dry friction of every gear, as the current that overcomes it.
        nm_per_a: torque of a servo per its current.
        stiffness_ma_per_deg: current of a servo per rotation from its goal.
        noise_ma: standard deviation of a measured current.
    """

    object: SimulatedObject | None = None
    friction_ma: NonNegative = 60.0
    nm_per_a: Positive = 0.354
    stiffness_ma_per_deg: Positive = 90.0
    noise_ma: NonNegative = 3.0


class RackFinger(RobotDescription):
    """A planar finger between two racks; it grows along +y and bends to +x when the right rack is longer.

    Axes: ``left`` and ``right``, the racks seen with the finger growing away from you. Targets: a tip in
    the plane.

    Attributes:
        model: ``rack_finger``.
        geometry: dimensions.
        limits: limits of racks and curvature.
        correction: measured curvature against commanded; none by default.
        sense: contacts, from the currents of its servos; off when left out.
        sim: object and friction of the simulated finger, for ``--mock`` and ``driver: sim``.
    """

    quantity: ClassVar[Quantity] = Quantity.LENGTH
    dimension: ClassVar[int] = 2

    model: Literal["rack_finger"]
    geometry: RackFingerGeometry
    limits: RackFingerLimits
    correction: CurvatureCorrection | None = None
    sense: CurrentSense | None = None
    sim: SimulatedFinger | None = None

    @model_validator(mode="after")
    def _rests_within_curvature(self) -> RackFinger:
        """Refuse a rest beyond the curvature: a stop by ``rest`` and a simulated run would never reach it."""
        if self.rest_mm is None or len(self.rest_mm) != len(self.axis_names):
            return self  # the number of lengths and their limits are checked with those of other robots
        left, right = self.rest_mm
        arc_mm = 0.5 * (left + right)
        if arc_mm < self.limits.arc_length_min_mm:
            raise ValueError(
                f"rest_mm: its arc is {arc_mm:g} mm long; allowed: at least arc_length_min_mm, "
                f"{self.limits.arc_length_min_mm:g}"
            )
        gain = 1.0 if self.correction is None else self.correction.gain(arc_mm)
        curvature_per_mm = abs(right - left) / (self.geometry.rack_spacing_mm * arc_mm) * gain
        most_per_mm = self.curvature_max_per_m / MM_PER_M
        if curvature_per_mm > most_per_mm * (1.0 + 1e-9):
            raise ValueError(
                f"rest_mm: its curvature is {curvature_per_mm:.3g} /mm; allowed: "
                f"at most {most_per_mm:.3g} /mm"
            )
        return self

    @property
    def axis_names(self) -> tuple[str, ...]:
        """In the paper L1 and L2."""
        return ("left", "right")

    @property
    def lower(self) -> Actuation:
        """Minimum rack lengths [m]."""
        return (self.limits.length_mm[0] / MM_PER_M,) * 2

    @property
    def upper(self) -> Actuation:
        """Maximum rack lengths [m]."""
        return (self.limits.length_mm[1] / MM_PER_M,) * 2

    @property
    def curvature_max_per_m(self) -> float:
        """The stated curvature limit, or the one of the links (Eq. 9) [1/m]."""
        stated = self.limits.curvature_max_per_mm
        return stated * MM_PER_M if stated is not None else self.geometry.link.curvature_max_per_m

    @property
    def section_lengths(self) -> tuple[SectionLength, ...]:
        """One arc, as long as the mean of its racks."""
        return (SectionLength(0.5 * (self.rest[0] + self.rest[1]), changes=True),)
