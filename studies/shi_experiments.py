"""Experiments 1-4 of Shi et al. in simulation: contid's inverse against a plant that is not its model.

The plant integrates the paper's literal equations by RK4 (another formulation, integrator and step than the
model's), with wrong parameters, play between commanded and acting pressure (hysteresis of the silicone), and
the regulators' error of 0.03 bar. Nothing here was measured on a robot.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.engine import Limits, RodSetup, RodSolver
from contid.kinematics.cosserat.section import Loads, Rod, Section
from contid.targets import Vec3
from studies.shi import Ends, forward
from studies.shi_paths import Run

#: Of the masses on the tip, as the paper rounds it [m/s^2].
GRAVITY_M_S2 = 9.81
#: Table I: modulus polynomials of the two segments.
MODULI_PA = ((1641.0, -13630.0, 43460.0, -65410.0, 76130.0), (8727.0, -44680.0, 96630.0, -107400.0, 90000.0))


def segment(kind: int, link: float = 0.0, **changes: Any) -> Section:
    """Segment 1 or 2 of the paper (kind 0 or 1), Table I; ``changes`` are further fields of the section."""
    return Section.from_radii(
        length=42.0,
        link=link,
        outer=7.5,
        inner=2.7,
        chamber=1.25,
        placement=5.1,
        pair_angle_rad=math.radians(56.0),
        modulus_pa=MODULI_PA[kind],
        **changes,
    )


def arm(segments: Sequence[int]) -> Rod:
    """The paper's arm of these segments, 5 mm of rigid link between two."""
    last = len(segments) - 1
    return Rod(tuple(segment(kind, 5.0 if i < last else 0.0) for i, kind in enumerate(segments)))


def setup(rod: Rod, upper_bar: float = 1.5) -> RodSetup:
    """Default settings of a robot file for a rod."""
    n = rod.pressures
    limits = Limits(np.zeros(n), np.full(n, upper_bar), np.full(n, 0.5 * upper_bar))
    return RodSetup(rod, Loads(), limits, 3, 0.03, 1e-4, 42.0, False)


@dataclass(frozen=True)
class Plant:
    """What differs from the model.

    Attributes:
        modulus: factor on E of each segment: the fit is a few percent off.
        gain: factor on the bending moment.
        play_bar: width of the play between commanded and acting pressure.
        noise_bar: greatest error of a regulator, uniform.
        elements: RK4 steps per segment.
        seed: of the regulators' errors.
    """

    modulus: tuple[float, float] = (1.04, 0.97)
    gain: float = 0.98
    play_bar: float = 0.03
    noise_bar: float = 0.03
    elements: int = 12
    seed: int = 1

    def rod(self, segments: Sequence[int]) -> Rod:
        """The arm with the plant's parameters."""
        nominal = arm(segments)
        return Rod(
            tuple(
                replace(
                    section,
                    modulus_pa=_scaled(section.modulus_pa, self.modulus[kind]),
                    bending_gain=self.gain,
                )
                for kind, section in zip(segments, nominal.sections, strict=True)
            )
        )

    def acting(self, commanded: Array) -> Array:
        """Pressures that act, row after row: noise at the regulator, then play, never below zero."""
        rng = np.random.default_rng(self.seed)
        noisy = commanded + rng.uniform(-self.noise_bar, self.noise_bar, commanded.shape)
        acting, half = np.empty_like(noisy), 0.5 * self.play_bar
        state = noisy[0]
        for i, row in enumerate(noisy):
            state = np.clip(state, row - half, row + half)
            acting[i] = np.maximum(state, 0.0)
        return acting

    def respond(self, run: Run, commanded: Array) -> Ends:
        """Where the plant's tip and mid-point go."""
        return forward(self.rod(run.segments), self.acting(commanded), _force(run), self.elements)


@dataclass(frozen=True, slots=True)
class ExperimentRow:
    """Errors of one run in the paper's form [mm, deg], simulated; None where a run has no such target.

    ``model_max`` is the solver's own residual [mm]: what is left of the errors without the plant.
    """

    experiment: int
    name: str
    paper: str
    tip_median: float
    tip_max: float
    tip_rmse: float
    mid_median: float | None
    mid_max: float | None
    angle_rmse: float | None
    angle_max: float | None
    model_max: float
    unmet: int


def _scaled(b: tuple[float, ...], factor: float) -> tuple[float, float, float, float, float]:
    return (factor * b[0], factor * b[1], factor * b[2], factor * b[3], factor * b[4])


def _force(run: Run) -> Array:
    return np.array([0.0, 0.0, run.grams * 1e-3 * GRAVITY_M_S2])


def _vec3(row: Array) -> Vec3:
    return (float(row[0]), float(row[1]), float(row[2]))


def solve_run(run: Run) -> tuple[Array, Array, int]:
    """Pressures along a run, warm-started from point to point; residuals; how many targets were not met."""
    engine = RodSolver(setup(arm(run.segments)))
    force = _vec3(_force(run))
    seed: tuple[float, ...] = (0.75,) * (3 * len(run.segments))
    pressures, residuals, unmet = [], [], 0
    for i in range(len(run.tip)):
        answer = engine.inverse(
            _vec3(run.tip[i]),
            None if run.mid is None else _vec3(run.mid[i]),
            None if run.direction is None else _vec3(run.direction[i]),
            force,
            seed,
        )
        seed = answer.pressures_bar
        pressures.append(seed)
        residuals.append(answer.residual_mm)
        unmet += not (answer.met and answer.stable)
    return np.array(pressures), np.array(residuals), unmet


def experiment(run: Run, plants: Sequence[Plant]) -> ExperimentRow:
    """One run on several plants, the paper's trials."""
    pressures, residuals, unmet = solve_run(run)
    tips, mids, angles = [], [], []
    for plant in plants:
        ends = plant.respond(run, pressures)
        tips.append(np.linalg.norm(ends.tip - run.tip, axis=1))
        if run.mid is not None:
            mids.append(np.linalg.norm(ends.mid - run.mid, axis=1))
        if run.direction is not None:
            axis = ends.rotation[:, :, 2] / np.linalg.norm(ends.rotation[:, :, 2], axis=1)[:, None]
            angles.append(np.degrees(np.arccos(np.clip(np.sum(axis * run.direction, axis=1), -1.0, 1.0))))
    tip = np.concatenate(tips)
    return ExperimentRow(
        run.experiment, run.name, run.paper,
        tip_median=float(np.median(tip)), tip_max=float(np.max(tip)),
        tip_rmse=float(np.sqrt(np.mean(tip**2))),
        mid_median=float(np.median(mids)) if mids else None, mid_max=float(np.max(mids)) if mids else None,
        angle_rmse=float(np.sqrt(np.mean(np.square(angles)))) if angles else None,
        angle_max=float(np.max(angles)) if angles else None,
        model_max=float(np.max(residuals)), unmet=unmet,
    )  # fmt: skip


def experiments(runs: Sequence[Run], trials: int) -> Iterator[ExperimentRow]:
    """Every run, row by row."""
    plants = [Plant(seed=trial) for trial in range(trials)]
    for run in runs:
        yield experiment(run, plants)
