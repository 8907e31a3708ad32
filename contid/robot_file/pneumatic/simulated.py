"""The ``sim`` of a pneumatic arm: payload, wall, errors of its model and tracker of the simulated arm.

An arm at rest is simulated by the equations of J. Shi et al., "Position and Orientation Control for
Hyper-elastic Multi-segment Continuum Robots" (``contid/kernels/plant``; errata in docs/robots/stiffflop.md).
"""

from __future__ import annotations

import random
from typing import Annotated, Self

from pydantic import Field, model_validator

from contid.robot_file.base import NonNegative, Strict
from contid.robot_file.clearance import PlaneDescription
from contid.robot_file.simulated_body import SimulatedPayload

#: An error of a parameter [%]: the simulated one is between half and twice that of the model.
_Percent = Annotated[float, Field(gt=-50, lt=100)]


class SimulatedErrors(Strict):
    """By what a simulated arm differs from the model of this file.

    Attributes:
        modulus_percent: percentage by which the modulus of every section, from the base, is greater.
        moment_percent: percentage by which the pressure moments are greater.
        regulator_bar: every regulator is off by a constant error up to this, drawn from ``seed``.
        hysteresis_bar: width of the loop between the pressure of a regulator and what acts.
        seed: seed of the errors of the regulators.
    """

    modulus_percent: tuple[_Percent, ...] = ()
    moment_percent: _Percent = 0.0
    regulator_bar: NonNegative = 0.0
    hysteresis_bar: NonNegative = 0.0
    seed: int = 0

    def modulus_scale(self, section: int) -> float:
        """Factor on the modulus of a section, counted from the base."""
        return 1.0 + (self.modulus_percent[section] / 100.0 if section < len(self.modulus_percent) else 0.0)

    @property
    def moment_scale(self) -> float:
        """Factor on the moments of the chambers."""
        return 1.0 + self.moment_percent / 100.0

    def regulator_offsets_bar(self, count: int) -> list[float]:
        """Constant errors of so many regulators."""
        rng = random.Random(f"{self.seed}:regulators")
        return [rng.uniform(-self.regulator_bar, self.regulator_bar) for _ in range(count)]


class SimulatedArm(SimulatedPayload):
    """What ``--mock`` and ``driver: sim`` simulate beside the devices; real devices ignore it.

    Attributes:
        dynamics: false: the arm is at rest at every instant, by the literal equations of the paper, not by
            contid's model; true: it moves with the masses and the damping of ``dynamics``, without a wall.
        wall: rigid and without friction, in the world; it stops the tip only.
        errors: how the arm differs from the model.
    """

    dynamics: bool = False
    wall: PlaneDescription | None = None
    errors: SimulatedErrors = SimulatedErrors()

    @model_validator(mode="after")
    def _free(self) -> Self:
        # The simulation of an arm in motion has no contact (docs/robots/dynamics.md).
        if self.dynamics and self.wall is not None:
            raise ValueError("dynamics: an arm in motion has no wall; leave one of the two out")
        return self
