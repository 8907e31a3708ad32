"""A simulated pneumatic arm at rest: regulators with errors, hysteresis, a payload, a wall."""

from __future__ import annotations

from typing import Final

from contid.robot_file.cosserat import Cosserat
from contid.units import BAR, MM_PER_M, STANDARD_GRAVITY
from contid_dynamics.arm_statics import Numbers, PlantEquilibrium, arm_solver

#: A new equilibrium that is not found in one step is approached in this many.
_PARTS: Final = 16


class SimulatedBody:
    """The tip of one arm over the pressures of its regulators.

    The arm is at rest at every instant, on the equilibrium that follows from the last one.

    Attributes:
        push_n: force of the wall on the tip [N].
        lost: the last equilibrium was not found, and the tip stays where it was.
    """

    def __init__(self, robot: Cosserat) -> None:
        assert robot.sim is not None
        self._sim = robot.sim
        self._solve = arm_solver(robot)
        self._down = robot.down_in_base
        base = robot.base
        self._origin, self._rotation = base.position_m, base.rotation
        self._offset = robot.sim.errors.regulator_offsets_bar(len(robot.axis_names))
        self._half = 0.5 * robot.sim.errors.hysteresis_bar
        self._acting: list[float] = []
        self._normal, self._wall_mm = (0.0, 0.0, 0.0), 0.0
        if robot.sim.wall is not None:
            self._normal, self._wall_mm = robot.sim.wall.in_base(base)
        #: Base moment [N·mm] and push of the wall [N] of the last equilibrium.
        self._unknowns: Numbers = (0.0, 0.0, 0.0, 0.0)
        #: Pressures [bar] and payload [N] of the last equilibrium.
        self._reached: tuple[tuple[float, ...], tuple[float, float, float]] | None = None
        self._tip_mm: Numbers = ()
        self.push_n = 0.0
        self.lost = False

    def follow(self, regulators_pa: list[float], t_s: float = 0.0) -> None:
        """The regulators reached pressures [Pa]; the chambers follow as far as the hysteresis lets them.

        Args:
            regulators_pa: pressures.
            t_s: time since the bus was opened; this arm is at rest at every instant.
        """
        pressures = [p / BAR for p in regulators_pa]
        if not self._acting:
            self._acting = pressures
        self._acting = [
            min(max(held, p - self._half), p + self._half)
            for held, p in zip(self._acting, pressures, strict=True)
        ]

    def payload_n(self, t_s: float) -> tuple[float, float, float]:
        """Force of the payload on the tip in the base frame [N], a time after the bus was opened."""
        weight = self._sim.payload_kg(t_s) * STANDARD_GRAVITY
        x, y, z = self._down
        return (weight * x, weight * y, weight * z)

    def tip_in_world_m(self, t_s: float) -> tuple[float, float, float]:
        """Where the tip is at rest [m], a time after the bus was opened."""
        pressures = tuple(max(0.0, p + off) for p, off in zip(self._acting, self._offset, strict=True))
        payload = self.payload_n(t_s)
        equilibrium = self._equilibrium(pressures, payload)
        self.lost = equilibrium is None
        if equilibrium is not None:
            self._tip_mm, self._unknowns = equilibrium
            self._reached = (pressures, payload)
        self.push_n = self._unknowns[3]
        return self._in_world(self._tip_mm)

    def _equilibrium(
        self, pressures: tuple[float, ...], payload: tuple[float, float, float]
    ) -> tuple[Numbers, Numbers] | None:
        """Tip [mm] and unknowns, by continuation from the last equilibrium.

        The first one is continued from the arm without pressure and payload.
        """
        begin = self._reached or ((0.0,) * len(pressures), (0.0, 0.0, 0.0))
        for parts in (1, _PARTS) if self._reached else (_PARTS,):
            guess = self._unknowns
            for part in range(1, parts + 1):
                share = part / parts
                p = [a + share * (b - a) for a, b in zip(begin[0], pressures, strict=True)]
                f = [a + share * (b - a) for a, b in zip(begin[1], payload, strict=True)]
                tip, guess, met = self._held_or_free(p, f, guess)
                if not met:
                    break
                if part == parts:
                    return tip, guess
        return None

    def _held_or_free(self, pressures: list[float], force: list[float], guess: Numbers) -> PlantEquilibrium:
        """The equilibrium with the tip off the wall, or on the wall where that pushes it outwards."""
        no_wall = (0.0, 0.0, 0.0)
        if self._sim.wall is None:
            return self._solve(pressures, force, guess, False, no_wall, 0.0)
        on_wall = guess[3] > 0.0
        for held in (on_wall, not on_wall):
            equilibrium = self._solve(pressures, force, guess, held, self._normal, self._wall_mm)
            tip, unknowns, met = equilibrium
            gap = sum(n * x for n, x in zip(self._normal, tip, strict=True)) - self._wall_mm
            if met and (unknowns[3] >= 0.0 if held else gap >= 0.0):
                return equilibrium
        return equilibrium

    def _in_world(self, tip_mm: Numbers) -> tuple[float, float, float]:
        x, y, z = (
            self._origin[i] + sum(self._rotation[3 * i + j] * tip_mm[j] for j in range(3)) / MM_PER_M
            for i in range(3)
        )
        return x, y, z
