"""How long a solve takes: contid's engine beside the paper's formulation, on the paper's trajectories."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from contid.kinematics.cosserat.engine import RodSolver
from studies.shi import inverse, unknowns
from studies.shi_experiments import GRAVITY_M_S2, arm, setup
from studies.shi_paths import Run, ellipse, spiral, square


@dataclass(frozen=True, slots=True)
class Speed:
    """Times of one trajectory [us].

    ``paper_*`` are of the paper's formulation on some of the same points, stopped by the paper's rule,
    ``scipy_*`` the same left to scipy's own tolerances.
    ``best_p99_us`` takes the fastest of the laps at each point before the percentile: what is left when other
    programs' share of the machine is taken out. ``paper_met`` of ``paper_points`` met the paper's rule.
    """

    name: str
    grams: float
    points: int
    median_us: float
    p99_us: float
    best_p99_us: float
    worst_us: float
    unmet: int
    paper_us: float
    paper_points: int
    paper_met: int
    scipy_us: float
    scipy_met: int

    @property
    def ratio(self) -> float:
        """How many times faster than the paper's formulation and rule, by medians."""
        return self.paper_us / self.median_us

    @property
    def scipy_ratio(self) -> float:
        """How many times faster than the same left to scipy's tolerances."""
        return self.scipy_us / self.median_us


def speed_runs(points: int) -> list[Run]:
    """One trajectory per mode, with and without a load."""
    circle, middle = ellipse(points, 30.0, 116.0, ratio=1.0), square(points, 20.0, 60.0)
    return [
        run
        for grams in (0.0, 10.0)
        for run in (
            Run(4, "one segment: spiral 24", (0,), spiral(points, 24.0, 55.0), grams=grams),
            Run(2, "mid + tip: S20C30", (0, 1), circle, middle, grams=grams),
            Run(
                3,
                "tip + direction: spiral 30, 30 deg",
                (0, 1),
                spiral(points, 30.0, 120.0),
                None,
                30.0,
                grams,
            ),
        )
    ]


def measure(run: Run, paper_points: int, laps: int = 5) -> Speed:
    """Warm-started solves along a run, as a control loop calls them; the first lap is not counted.

    The baseline is solved between the laps, under the same load of the machine, and counted in processor
    time: its milliseconds would otherwise include other programs' time slices.
    """
    engine = RodSolver(setup(arm(run.segments)))
    force = (0.0, 0.0, run.grams * 1e-3 * GRAVITY_M_S2)
    tips = [tuple(row) for row in run.tip.tolist()]
    mids = [None] * len(tips) if run.mid is None else [tuple(row) for row in run.mid.tolist()]
    directions = run.direction
    axes = [None] * len(tips) if directions is None else [tuple(row) for row in directions.tolist()]
    seed: tuple[float, ...] = (0.75,) * (3 * len(run.segments))
    times = np.empty((laps + 1, len(tips)))
    unmet = 0
    baseline = paper_solves(run, by_the_paper=True), paper_solves(run, by_the_paper=False)
    required = paper_points, max(3, paper_points // 4)
    solved: tuple[list[float], list[float]] = ([], [])
    met = [0, 0]
    for lap in range(laps + 1):
        for solves, kind in zip(baseline, range(2), strict=True):
            while len(solved[kind]) < required[kind] * lap / laps:
                seconds, good = next(solves)
                solved[kind].append(seconds)
                met[kind] += good
        for i, (tip, mid, axis) in enumerate(zip(tips, mids, axes, strict=True)):
            started = time.perf_counter()
            answer = engine.inverse(tip, mid, axis, force, seed)
            times[lap, i] = time.perf_counter() - started
            seed = answer.pressures_bar
            unmet += not (answer.met and answer.stable)
    # The first point of a lap is a jump from the end of the one before.
    counted = times[1:, 1:] * 1e6
    paper, slow = solved
    return Speed(
        run.name, run.grams, len(tips), float(np.median(counted)), float(np.percentile(counted, 99)),
        float(np.percentile(counted.min(axis=0), 99)), float(np.max(counted)), unmet,
        float(np.median(paper)) * 1e6, len(paper), met[0], float(np.median(slow)) * 1e6, met[1],
    )  # fmt: skip


def paper_solves(run: Run, by_the_paper: bool) -> Iterator[tuple[float, bool]]:
    """Solves of eqs. (15)-(17) by scipy's trust-region-reflective method, from point to point.

    Yields the processor time [s] and whether the paper's rule was met.

    The direction task is posed as the paper poses it, with a whole frame: the twist the model itself ends up
    with, so that a solution exists (a frame with another roll has none).
    """
    rod = arm(run.segments)
    force = np.array([0.0, 0.0, run.grams * 1e-3 * GRAVITY_M_S2])
    engine = RodSolver(setup(rod))
    seed: tuple[float, ...] = (0.75,) * (3 * len(run.segments))
    state = None
    directions = run.direction
    first = len(run.tip) // 2
    for i in range(first, len(run.tip)):
        mid = None if run.mid is None else run.mid[i]
        axis = None if directions is None else directions[i]
        seed = engine.inverse(
            run.tip[i].tolist(),
            None if mid is None else mid.tolist(),
            None if axis is None else axis.tolist(),
            (0.0, 0.0, float(force[2])),
            seed,
        ).pressures_bar
        at = engine.forward(seed, (0.0, 0.0, float(force[2])))
        frame = None if axis is None else np.array(at.rotation).reshape(3, 3)
        if state is None:
            state = unknowns(rod, np.array(seed), force, np.array(at.base_moment_nmm))
            continue
        started = time.thread_time()
        state, good = inverse(rod, state, force, run.tip[i], mid, frame, by_the_paper=by_the_paper)
        yield time.thread_time() - started, good


def measure_all(points: int, paper_points: int) -> Iterator[Speed]:
    """Every trajectory of `speed_runs`."""
    for run in speed_runs(points):
        yield measure(run, paper_points)
