"""A tendon rod as elements of constant strain, and its equilibrium: what the kernel takes and gives."""

from __future__ import annotations

from dataclasses import dataclass

from contid.kinematics.array import Array


@dataclass(frozen=True, eq=False)
class RodElements:
    """Elements of a rod from the base on; the kernel reads the fields by name.

    Attributes:
        lengths: lengths of the elements [m].
        stiffness: stiffness of each element: bend u, v, twist [N m], stretch [N m], 0 without; ``(elements,
            4)``.
        arms: lever arms of every tendon in every element [m], NaN where it does not pass; ``(elements,
            tendons, 2)``.
        rigid: length of the rigid piece after each element [m].
        tendon: stiffness of each tendon [N/m].
        rest: tensions of the straight rod at zero pulls [N].
        weight: weight of each element [N], in the base frame; ``(elements, 3)``.
        offset: position of the tip, in the frame of the last element [m].
        base_m: length before the first element [m].
        per_section: elements of a section.
        stretches: the backbone is extensible.
    """

    lengths: Array
    stiffness: Array
    arms: Array
    rigid: Array
    tendon: Array
    rest: Array
    weight: Array
    offset: Array
    base_m: float
    per_section: int
    stretches: bool


@dataclass(frozen=True, eq=False)
class TendonEquilibrium:
    """The rod in equilibrium, in the base frame.

    Attributes:
        points_m: ends of the elements from the base on, rigid pieces included, ``(nodes, 3)``.
        tip_m: tip of the robot ``(3,)``.
        rotation: frame of the tip ``(3, 3)``.
        ends_m: end of each section, its rigid piece included, ``(sections, 3)``.
        tensions_n: tensions of the tendons ``(tendons,)`` [N].
        strain: strain of every element: bend u, v, twist [rad], stretch; ``(elements, 4)``.
        jacobian: derivative of the tip by the pulls ``(3, tendons)``.
        compliance: derivative of the tip by a force on it [m/N], ``(3, 3)``.
    """

    points_m: Array
    tip_m: Array
    rotation: Array
    ends_m: Array
    tensions_n: Array
    strain: Array
    jacobian: Array
    compliance: Array
