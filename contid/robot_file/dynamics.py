"""The ``dynamics`` of a robot: what its body weighs, how its motion dies out, how its actuators answer."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from contid.robot_file.base import NonNegative, Positive, Strict

#: Sections of a robot at most.
_SECTIONS = 8


class Dynamics(Strict):
    """The moving body of a robot whose statics is a rod; `contid modes` and the moving twin need it.

    Weight acts on it as in the statics of the file: a robot whose model leaves weight out swings about the
    shapes of that model.

    Attributes:
        mass_g_per_m: mass along the backbone with everything on it, discs and tendons too: one number for
            all sections, or one per section. Left out, the weight of the statics counts.
        tip_mass_g: mass on the tip, such as a gripper.
        radius_mm: radius of the discs or of the body, whose mass turns with the sections.
        damping_ms: time of Kelvin and Voigt: the damping of every strain is that times its stiffness. A mode
            of frequency f has the damping ratio pi f times it.
        delay_ms: dead time between a command and the motion of its actuator: one number for all axes, or one
            per axis.
        lag_ms: time constant of the first-order answer after that: one number for all axes, or one per axis.
        elements: elements of a section in motion; the error falls with the square of it.
    """

    mass_g_per_m: Annotated[tuple[Positive, ...], Field(min_length=1, max_length=_SECTIONS)] | None = None
    tip_mass_g: NonNegative = 0.0
    radius_mm: Positive | None = None
    damping_ms: NonNegative
    delay_ms: Annotated[tuple[NonNegative, ...], Field(min_length=1)] = (0.0,)
    lag_ms: Annotated[tuple[NonNegative, ...], Field(min_length=1)] = (0.0,)
    elements: Annotated[int, Field(ge=1, le=32)] = 4

    def check(self, sections: int, axes: int, weighed: bool) -> None:
        """Whether the numbers fit a robot.

        Args:
            sections: its sections.
            axes: axes of its model.
            weighed: its statics know its weight.

        Raises:
            ValueError: with the key and the counts that are allowed.
        """
        if self.mass_g_per_m is None and not weighed:
            raise ValueError("dynamics needs mass_g_per_m: the statics of this robot have no weight")
        for key, count, what in (
            ("mass_g_per_m", sections, "section"), ("delay_ms", axes, "axis"), ("lag_ms", axes, "axis"),
        ):  # fmt: skip
            values = getattr(self, key)
            if values is not None and len(values) not in (1, count):
                raise ValueError(
                    f"dynamics.{key} has {len(values)} numbers; allowed: 1 or {count}, one per {what}"
                )
