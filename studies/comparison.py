"""Table I of Singh et al. beside today's figures, and why its damped least squares drifts; all simulated."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.arc.section_model import build_solver
from contid.kinematics.arc.solver import Solver
from contid.kinematics.array import Array
from contid.targets import vec3
from contid_ropes.ph.model import ShapeInverse, TubeSection, arc_direction
from studies import singh
from studies.arc_chains import differentiate, forward
from studies.distal_learning import InverseNetwork

#: Lengths along one path or many, from tips and the lengths at the start.
Along: TypeAlias = Callable[[Array, Array], Array]
#: Lengths for the point after one with known lengths: (target, point before, lengths before).
Step: TypeAlias = Callable[[Array, Array, Array], Array]

_SECTIONS: Final = singh.cbha_sections()


@dataclass(frozen=True, slots=True)
class Method:
    """One method from tips to lengths, with its row of the paper's Table I."""

    name: str
    along: Along
    step: Step
    paper_mm: tuple[float, float, float] | None = None
    paper_us: float | None = None


@dataclass(frozen=True, slots=True)
class ComparisonRow:
    """Results of one method; errors in mm, times in us.

    Attributes:
        name: the method.
        max_mm: greatest error in x, y and z on the golden trajectory.
        mean_mm: mean distance on the golden trajectory.
        random_median_mm, random_worst_mm: of the greatest distance on each random trajectory.
        outside_mm: by how much lengths left their limits on the random trajectories, at worst.
        time_us: median time per point on the golden trajectory, each point from the one before.
        paper_mm, paper_us: what Table I prints, measured on the authors' robot and computer.
    """

    name: str
    max_mm: tuple[float, float, float] | None
    mean_mm: float | None
    random_median_mm: float | None
    random_worst_mm: float | None
    outside_mm: float | None
    time_us: float | None
    paper_mm: tuple[float, float, float] | None
    paper_us: float | None


@dataclass(frozen=True, slots=True)
class Drift:
    """Error of the printed damped least squares after some points, split exactly into its two sources [mm].

    Each step loses ``(I - J J^T (J J^T + lambda^2)^-1) de`` to damping and ``J dl - (p(l + dl) - p(l))`` to
    linearisation; nothing is ever fed back, so both add up.
    """

    damping: float
    point: int
    error_mm: float
    from_damping_mm: float
    from_linearisation_mm: float
    with_feedback_mm: float


def cbha() -> Feasible:
    """The reference's CBHA with its limits."""
    return Feasible(_SECTIONS, (0.100, 0.090), (0.150, 0.140))


def bounded(name: str, solver: Solver) -> Method:
    """The solver robots run on, as a method of the table."""

    def step(target: Array, before: Array, lengths: Array) -> Array:
        return np.array(solver.solve(vec3(target.tolist()), None, None, tuple(lengths.tolist())).lengths)

    def along(tips: Array, start: Array) -> Array:
        paths, starts = tips.reshape(-1, *tips.shape[-2:]), start.reshape(-1, 6)
        found = np.empty((*paths.shape[:-1], 6))
        for k, path in enumerate(paths):
            lengths = starts[k]
            for j, target in enumerate(path):
                lengths = found[k, j] = step(target, target, lengths)
        return found.reshape(*tips.shape[:-1], 6)

    return Method(name, along, step)


def by_shape(feasible: Feasible) -> Method:
    """The solver ``ph`` of a robot file, given tips only: the direction is that of one arc."""
    angles = feasible.sections.angles_rad
    tubes = [TubeSection(d, each) for d, each in zip(feasible.sections.radius_m, angles, strict=True)]
    home = feasible.home.reshape(-1, 3).sum(axis=1)
    prepared = ShapeInverse(tubes, (home / home.sum()).tolist())

    def step(target: Array, before: Array, lengths: Array) -> Array:
        tip = vec3(target.tolist())
        return feasible.pulled(prepared.solve(tip, arc_direction(tip)).lengths_m)

    def along(tips: Array, start: Array) -> Array:
        found = np.array([step(tip, tip, tip) for tip in tips.reshape(-1, 3)])
        return found.reshape(*tips.shape[:-1], 6)

    return Method("PH quintic, direction of one arc (native)", along, step)


def _printed_dls(
    damping: float, paper_mm: tuple[float, float, float] | None = None, paper_us: float | None = None
) -> Method:
    return Method(
        f"DLS as printed, lambda {damping:g} (NumPy)",
        lambda tips, start: singh.dls_as_printed(_SECTIONS, tips, start, damping),
        lambda target, before, lengths: _dls(lengths, target - before, damping),
        paper_mm,
        paper_us,
    )


def methods(network: InverseNetwork | None) -> list[Method]:
    """All methods; the neural network if given."""
    table = [
        Method(
            "Newton-Raphson (NumPy)",
            lambda tips, start: singh.newton_raphson_path(_SECTIONS, tips, start),
            lambda target, before, lengths: singh.newton_raphson(_SECTIONS, target, lengths)[0],
            (0.146, 0.219, 0.975),
            233_500.0,
        )
    ]
    table.append(_printed_dls(0.5, (16.208, 18.104, 24.155), 500.0))
    table.append(_printed_dls(0.1))
    table.append(
        Method(
            "DLS with feedback, lambda 0.5 (NumPy)",
            lambda tips, start: singh.dls_with_feedback(_SECTIONS, tips, start),
            lambda target, before, lengths: _dls(lengths, target - forward(_SECTIONS, lengths).tip, 0.5),
        )
    )
    if network is not None:
        table.append(
            Method(
                f"neural network, {network.network.hidden} neurons (NumPy)",
                lambda tips, start: network.lengths(tips),
                lambda target, before, lengths: network.lengths(target),
                (11.791, 3.491, 9.547),
                13_800.0,
            )
        )
    feasible = cbha()
    table.append(by_shape(feasible))
    table.append(bounded("contid, bounded (native)", build_solver(feasible)))
    return table


def compare(
    table: list[Method], random: int, report: Callable[[str], None] = lambda name: None, laps: int = 5
) -> list[ComparisonRow]:
    """Run every method on the golden and on ``random`` random trajectories."""
    golden = singh.golden_trajectory()
    rng = np.random.default_rng(2017)
    paths = [singh.random_trajectory(rng) for _ in range(random)]
    rows = []
    for method in table:
        report(method.name)
        lengths = method.along(golden.tips_m, golden.lengths_m[0])
        error = 1e3 * (forward(_SECTIONS, lengths).tip - golden.tips_m)
        worst = np.abs(error).max(axis=0)
        median = highest = outside = None
        if paths:
            tips = np.stack([path.tips_m for path in paths])
            found = method.along(tips, np.stack([path.lengths_m[0] for path in paths]))
            each = 1e3 * np.linalg.norm(forward(_SECTIONS, found).tip - tips, axis=-1).max(axis=-1)
            median, highest = float(np.median(each)), float(np.max(each))
            beyond = np.maximum(np.array(singh.LOWER_M) - found, found - np.array(singh.UPPER_M))
            outside = 1e3 * max(0.0, float(beyond.max()))
        rows.append(
            ComparisonRow(
                method.name,
                (float(worst[0]), float(worst[1]), float(worst[2])),
                float(np.linalg.norm(error, axis=-1).mean()),
                median,
                highest,
                outside,
                _time_us(method, golden, lengths, laps),
                method.paper_mm,
                method.paper_us,
            )
        )
    # Seventeen vertebrae as parallel robots: the text gives neither radii nor joints nor the split of tubes.
    rows.append(
        ComparisonRow(
            "hybrid: not reproducible from the text", *(None,) * 6, (15.519, 5.392, 9.930), 12_000.0
        )
    )
    return rows


def drift(points: tuple[int, ...] = (10, 25, 50, 75, 99)) -> list[Drift]:
    """Where the error of the printed method comes from, on the golden trajectory."""
    golden = singh.golden_trajectory()
    found = []
    for damping in (0.5, 0.1, 0.01):
        fed_back = singh.dls_with_feedback(_SECTIONS, golden.tips_m, golden.lengths_m[0], damping)
        fed_error = 1e3 * np.linalg.norm(forward(_SECTIONS, fed_back).tip - golden.tips_m, axis=-1)
        lengths, lost, bent = golden.lengths_m[0], np.zeros(3), np.zeros(3)
        for k in range(1, len(golden.tips_m)):
            at = differentiate(_SECTIONS, lengths)
            wish = golden.tips_m[k] - golden.tips_m[k - 1]
            dl = singh.damped(at.tip, wish, damping)
            after = forward(_SECTIONS, lengths + dl).tip
            lost = lost + (wish - at.tip @ dl)
            bent = bent + (at.tip @ dl - (after - at.frames.tip))
            lengths = lengths + dl
            if k in points:
                found.append(
                    Drift(
                        damping,
                        k,
                        1e3 * float(np.linalg.norm(golden.tips_m[k] - after)),
                        1e3 * float(np.linalg.norm(lost)),
                        1e3 * float(np.linalg.norm(bent)),
                        float(fed_error[k]),
                    )
                )
    return found


def _dls(lengths: Array, de_m: Array, damping: float) -> Array:
    return lengths + singh.damped(differentiate(_SECTIONS, lengths).tip, de_m, damping)


def _time_us(method: Method, path: singh.TubeTrajectory, lengths: Array, laps: int) -> float:
    """Median over points and laps; the lengths before each point are the method's own."""
    times = []
    for _ in range(laps):
        for k in range(1, len(path.tips_m)):
            begin = time.perf_counter_ns()
            method.step(path.tips_m[k], path.tips_m[k - 1], lengths[k - 1])
            times.append(time.perf_counter_ns() - begin)
    return 1e-3 * statistics.median(times)
