"""An arm with the identified error of its model: the tip under pressures and a force, and how sure it is.

Pressures in bar, lengths in mm, forces in N, moments in N·mm, as the kernel has them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, TypeAlias

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.engine import NearAnswer, RodSolver
from contid.kinematics.cosserat.identified import SectionErrors, scaled_arm, section_errors
from contid.kinematics.cosserat.model import build_setup
from contid.robot_file.cosserat import Cosserat
from contid.targets import ZERO3, Vec3
from contid.units import BAR

#: Integration steps per section. They are never doubled, because the tip would jump where that happens: an
#: error of `_NEVER_MM` asks for no doubling.
ELEMENTS: Final = 6
_NEVER_MM: Final = 1e9
#: Steps of the difference quotients by moduli, moments [-], densities [kg/m^3] and masses of links [g].
_STEPS: Final = (1e-3, 1e-3, 1.0, 0.01)
#: The half loop of an axis is that of the calibration, but at least and at most these parts of the range of
#: the axis (`IdentifiedArm.half_loop`).
HALF_LOOP_RANGE: Final = (0.002, 0.02)

#: One number per axis, or the components of a vector.
Numbers: TypeAlias = tuple[float, ...]


class IdentifiedArm:
    """The model of a robot file with what ``sense.load.calibration`` adds.

    Attributes:
        half_loop: half width of the hysteresis loop of every axis [bar], positive: the sides that `corrected`
            takes are computed from the commands by a division by it. `corrected` itself uses the loop of the
            calibration as it is: its sign is that of the effect of a side, and it may be zero.
        steps: by which `near` raises an error of the sections.
    """

    def __init__(self, robot: Cosserat) -> None:
        assert robot.sense is not None
        self._calibration = calibration = robot.sense.load.calibration
        sections = len(robot.geometry.sections)
        self._engines: list[RodSolver] = []
        errors = np.array(section_errors(calibration).row)
        self.steps: Array = np.repeat(_STEPS, sections)[: len(errors)]
        for row in (errors, *(errors + np.diag(self.steps))):
            setup = build_setup(scaled_arm(robot, SectionErrors.of(row.tolist(), sections)))
            self._engines.append(RodSolver(replace(setup, elements=ELEMENTS, error=_NEVER_MM)))
        lower, upper = np.array(robot.lower) / BAR, np.array(robot.upper) / BAR
        self._middle: list[float] = (0.5 * (lower + upper)).tolist()
        low, high = (part * (upper - lower) for part in HALF_LOOP_RANGE)
        self.half_loop: list[float] = np.clip(np.abs(calibration.loop_bar), low, high).tolist()
        self._sections = sections
        self._axis_bar2 = calibration.axis_sigma_bar**2
        self._tip_mm2 = calibration.tip_sigma_mm**2 * np.eye(3)
        width = len(calibration.covariance_factor)
        self._factor = np.zeros((width, width))
        for i, row_of_factor in enumerate(calibration.covariance_factor):
            self._factor[i, : len(row_of_factor)] = row_of_factor

    @property
    def scales(self) -> int:
        """Number of the errors of sections: moduli, moments, and masses where they are identified."""
        return len(self._engines) - 1

    def corrected(self, pressures: Sequence[float], sides: Sequence[float]) -> Numbers:
        """The pressures [bar] at which the model has the tip that the arm has at ``pressures``.

        ``sides`` are those of the hysteresis of each axis, -1 to 1.
        """
        found = self._calibration
        return tuple(
            [
                p + offset + gain * (p - middle) + loop * side
                for p, side, middle, offset, gain, loop in zip(
                    pressures, sides, self._middle, found.offset_bar, found.gain, found.loop_bar, strict=True
                )
            ]
        )

    def near(
        self, corrected: Sequence[float], force_n: Vec3, guess: Sequence[float], scale: int = -1
    ) -> NearAnswer | None:
        """The equilibrium near a base moment ``guess`` [N·mm]; None when there is none.

        With ``scale``, the error of that number is raised by its step.
        """
        return self._engines[scale + 1].near(corrected, force_n, guess)

    def base_moment(self, corrected: Sequence[float], force_n: Vec3 = ZERO3) -> Numbers | None:
        """The base moment on the branch from the unloaded arm; None where it is unstable."""
        found = self._engines[0].forward(corrected, force_n)
        return found.base_moment_nmm if found.stable else None

    def covariance_mm2(
        self, pressures: Sequence[float], sides: Sequence[float], by_pressure: Array, by_scale: Array
    ) -> Array:
        """Covariance of the tip by the uncertainty of the calibration, shape ``(3, 3)`` [mm^2].

        Args:
            pressures: measured [bar].
            sides: sides of their hysteresis.
            by_pressure: derivative of the tip [mm/bar], shape ``(3, k)``.
            by_scale: derivative of the tip by the errors of sections [mm by their unit], shape ``(3, m)``.
        """
        away = np.array(pressures) - self._middle
        # In the order of ``covariance_factor`` (`contid.robot_file.pneumatic.sense.ModelErrors`): by offsets,
        # gains and loops of the axes, then by the errors of the sections.
        columns = np.concatenate(
            [by_pressure, by_pressure * away, by_pressure * np.array(sides), by_scale], axis=1
        )
        root = columns @ self._factor
        spread: Array = root @ root.T + self._axis_bar2 * by_pressure @ by_pressure.T
        return spread + self._tip_mm2

    def creep_mm(self, decades: float, by_scale: Array) -> tuple[Array, Array]:
        """How far the tip crept in these decades beyond 1 s of the pose's age [mm], and the covariance of it.

        Args:
            decades: log10 of the age over 1 s, see `contid_fit.sense.creep`.
            by_scale: derivative of the tip by the errors of sections [mm by their unit], shape ``(3, m)``.
        """
        # The modulus falls with the age, and ``by_scale`` is for moduli that rise: hence the sign below.
        by_modulus = decades * by_scale[:, : self._sections].sum(axis=1)
        spread: Array = self._calibration.creep_sigma**2 * np.outer(by_modulus, by_modulus)
        return -self._calibration.creep_per_decade * by_modulus, spread

    @property
    def creeps(self) -> bool:
        """True where the calibration found a creep."""
        return self._calibration.creep_sigma > 0.0

    def sides_mm2(self, unknown: Sequence[float], by_pressure: Array) -> Array:
        """Covariance of the tip by unknown sides, uniformly distributed from -1 to 1 [mm^2].

        Args:
            unknown: 1 for an axis with an unknown side, 0 for the others.
            by_pressure: derivative of the tip [mm/bar], shape ``(3, k)``.
        """
        columns = by_pressure * (np.array(unknown) * np.array(self._calibration.loop_bar))
        spread: Array = columns @ columns.T / 3.0
        return spread
