"""Figures of the Pythagorean-hodograph curves: times beside other methods, arcs, catenaries, noise, a plot.

Run from the root of the repository: ``python benchmarks/ph_curve.py [docs/images/ph-catenary.svg]``. Times
are medians of one run on one machine; compare ratios. Everything is simulated.
"""

from __future__ import annotations

import math
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from contid.kernels import load
from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.arc.section_model import build_solver
from contid.kinematics.array import Array
from contid.targets import ZERO3, Vec3
from contid_ropes.catenary import Catenary, as_quintic, hang
from contid_ropes.ph.ends import CurveEnds, PhFit, through
from contid_ropes.ph.model import ShapeInverse
from studies import singh
from studies.arc_chains import biarc, forward, lengths_of
from studies.shape_comparison import compare_shapes, split_of, tube_sections

SECTIONS = singh.cbha_sections()
#: The rope of the reference's closed chain: 1 m between (-76, 16, 211) and (782, 26, 206) mm.
B, C = (-0.0755225947, 0.0157220420, 0.2109108878), (0.7824211695, 0.0256798210, 0.2063406479)
TURNS = np.arange(0.0, 10.5, 0.5)
STRETCHES = np.arange(-2.0, 3.1, 0.25)


def median_us(call: Callable[[int], object], count: int, laps: int = 20) -> float:
    """Median time of a call for each of ``count`` inputs."""
    spent = []
    for _ in range(laps):
        for k in range(count):
            begin = time.perf_counter_ns()
            call(k)
            spent.append(time.perf_counter_ns() - begin)
    return statistics.median(spent) / 1e3


def rows_us(native: Any, poses: Array, out: Array) -> float:
    """Median time of all poses in one call of the kernel."""
    return median_us(lambda _: native.solve_rows(poses, out), 1, 300)


def times() -> None:
    """One full inverse per pose of the golden trajectory, by every method."""
    golden = singh.golden_trajectory()
    frames = forward(SECTIONS, golden.lengths_m)
    tips = [(float(x), float(y), float(z)) for x, y, z in golden.tips_m]
    ways = [(float(x), float(y), float(z)) for x, y, z in frames.rotation[:, :, 2]]
    lengths = golden.lengths_m.sum(axis=1) / 3.0
    split = split_of(golden.lengths_m[0])
    count, rows = len(tips), []
    kernel = load("ph_curve")
    for what, known in (("unknown", np.full(count, math.nan)), ("known", lengths)):
        native = kernel.ShapeInverse(
            [each.distance_m for each in tube_sections()],
            [list(each.angles_rad) for each in tube_sections()],
            list(split),
        )
        poses = np.ascontiguousarray(np.column_stack([golden.tips_m, frames.rotation[:, :, 2], known]))
        out = np.empty((count, 6))
        rows.append((f"PH, length {what}, in the kernel", rows_us(native, poses, out) / count))
    prepared = ShapeInverse(tube_sections(), split)
    rows.append(
        ("PH, length unknown, from Python", median_us(lambda k: prepared.solve(tips[k], ways[k]), count))
    )
    rows.append(
        (
            "PH, length known, from Python",
            median_us(lambda k: prepared.solve(tips[k], ways[k], float(lengths[k])), count),
        )
    )
    bounded: Any = build_solver(Feasible(SECTIONS, (0.100, 0.090), (0.150, 0.140)))
    seeds = [tuple(row) for row in golden.lengths_m.tolist()]
    out = np.empty((count, 6))
    us = median_us(lambda _: bounded.follow(golden.tips_m, seeds[0], out), 1, 300) / count
    rows.append(("bounded Newton, tip, in the kernel", us))
    rows.append(
        (
            "bounded Newton, tip, from Python",
            median_us(lambda k: bounded.solve(tips[k], None, None, seeds[max(k - 1, 0)]), count),
        )
    )
    rows.append(
        (
            "bounded Newton, tip and direction, from Python",
            median_us(lambda k: bounded.solve(tips[k], ways[k], None, seeds[max(k - 1, 0)]), count),
        )
    )

    def one_biarc(k: int) -> object:
        arcs = biarc(golden.tips_m[k], frames.rotation[k, :, 2], 0.0625, (0.0, 0.0))
        return None if arcs is None else lengths_of(SECTIONS, np.array(arcs))

    rows.append(("biarc of one control leg, in NumPy", median_us(one_biarc, count, 5)))
    rows.append(
        (
            "Newton-Raphson of the paper, in NumPy",
            median_us(
                lambda k: singh.newton_raphson(SECTIONS, golden.tips_m[k], golden.lengths_m[max(k - 1, 0)]),
                count,
                2,
            ),
        )
    )
    print("time per pose (paper, MATLAB: PH 270 us, Newton-Raphson 233500 us)")
    for name, us in rows:
        print(f"  {name:48} {us:8.2f} us")


def closed_form_length() -> None:
    """Length in closed form against Gauss quadrature of the speed (exact for it: degree four)."""
    rng = np.random.default_rng(1)
    nodes, weights = np.polynomial.legendre.leggauss(5)
    worst = 0.0
    for _ in range(2000):
        d0, d1 = rng.normal(size=(2, 3))
        p1 = rng.normal(size=3)
        d0, d1 = d0 / np.linalg.norm(d0), d1 / np.linalg.norm(d1)
        chord = float(np.linalg.norm(p1))
        ends = CurveEnds(ZERO3, tuple(p1.tolist()), tuple(d0.tolist()), tuple(d1.tolist()))
        curve = through(ends, chord * float(rng.uniform(1.05, 3.0))).curve
        by_speed = 0.5 * float(weights @ curve.speed(0.5 * (nodes + 1.0)))
        worst = max(worst, abs(curve.length_m / by_speed - 1.0))
    print(f"length against quadrature, 2000 random curves: {worst:.1e} relative at worst")


def arcs() -> None:
    """Circular arcs from their ends and length: greatest error at equal arc length."""
    print("arc [deg]: error [% of its length]")
    share = np.linspace(0.0, 1.0, 201)
    for degrees in range(30, 331, 30):
        angle = math.radians(degrees)
        turn = angle * share
        true = np.column_stack([1.0 - np.cos(turn), np.zeros(201), np.sin(turn)]) / angle
        direction = (math.sin(angle), 0.0, math.cos(angle))
        beta = math.pi if degrees > 180 else 0.0
        fit = through(CurveEnds(ZERO3, tuple(true[-1].tolist()), (0.0, 0.0, 1.0), direction), 1.0, beta)
        print(f"  {degrees:3}  {100.0 * _worst(true, fit)[1]:.5f}")


def catenaries() -> None:
    """One quintic with exact directions and length, by slack and height difference."""
    print("length/span: error of a 1 m rope [mm], ends level | ends 0.3 spans apart in height")
    for slack in (1.05, 1.2, 1.5, 2.0, 3.0):
        errors = []
        for rise in (0.0, 0.3):
            span = 1.0 / (slack * math.hypot(1.0, rise))
            rope = _rope(ZERO3, (span, 0.0, rise * span))
            errors.append(1e3 * _worst(rope.points(401), as_quintic(rope))[1])
        print(f"  {slack:4}  {errors[0]:.3f} | {errors[1]:.3f}")
    rope = _rope(B, C)
    mean, worst = _worst(rope.points(401), as_quintic(rope))
    print(f"the chain's rope (length/chord 1.17): {1e3 * mean:.4f} mm mean, {1e3 * worst:.4f} mm at worst")
    unknown = through(CurveEnds(B, C, rope.start_direction, rope.end_direction))
    print(f"  length unknown: {1e3 * _worst(rope.points(401), unknown)[0]:.1f} mm mean")


def growth() -> tuple[np.ndarray, np.ndarray]:
    """Mean and greatest error [mm] of the chain's rope by direction errors [deg] and by length errors [%].

    Both directions are tilted by the same angle, each to six sides in turn: mean and greatest over all pairs.
    """
    rope = _rope(B, C)
    true = rope.points(201)
    by_turn = []
    for degrees in TURNS:
        angle = math.radians(float(degrees))
        pairs = [
            _worst(true, through(CurveEnds(B, C, first, last), 1.0))
            for first in _tilted(rope.start_direction, angle)
            for last in _tilted(rope.end_direction, angle)
        ]
        by_turn.append((float(np.mean([mean for mean, _ in pairs])), max(worst for _, worst in pairs)))
    by_length = []
    for percent in STRETCHES:
        ends = CurveEnds(B, C, rope.start_direction, rope.end_direction)
        by_length.append(_worst(true, through(ends, 1.0 + float(percent) / 100.0)))
    return 1e3 * np.array(by_turn), 1e3 * np.array(by_length)


def noise() -> None:
    """Errors of tube totals with a noisy tracker, golden trajectory gone through 20 times."""
    for mm, degrees in ((1.0, 1.0), (2.0, 2.0)):
        row = compare_shapes(mm, degrees, laps=20)[0]
        mean, worst = (", ".join(f"{v:.2f}" for v in values) for values in (row.mean_mm, row.max_mm))
        print(f"noise {mm:g} mm / {degrees:g} deg, length unknown: totals mean {mean}; max {worst} mm")


def plot(path: Path, by_turn: np.ndarray, by_length: np.ndarray) -> None:
    """The growth of the error, two panels."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 3.0), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for axes, x, table, label in (
        (left, TURNS, by_turn, "both directions off by [deg]"),
        (right, STRETCHES, by_length, "length off by [%]"),
    ):
        axes.plot(x, table[:, 1], color="#D55E00", label="greatest")
        axes.plot(x, table[:, 0], color="#0072B2", label="mean")
        axes.set_xlabel(label)
        axes.grid(alpha=0.3)
    left.set_ylabel("error of a 1 m rope [mm]")
    left.set_ylim(bottom=0.0)
    left.legend(frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None})


def _rope(start: Vec3, end: Vec3) -> Catenary:
    rope = hang(start, end, 1.0)
    assert rope is not None
    return rope


def _worst(true: np.ndarray, fit: PhFit) -> tuple[float, float]:
    """Mean and greatest distance at equal shares of the length."""
    off = np.linalg.norm(fit.curve.evenly(len(true)) - true, axis=1)
    return float(off.mean()), float(off.max())


def _tilted(direction: Vec3, angle: float) -> list[Vec3]:
    """A direction tilted by an angle to six sides."""
    t = np.array(direction)
    u = np.cross(t, (0.0, 0.0, 1.0))
    u /= np.linalg.norm(u)
    v = np.cross(t, u)
    found = []
    for side in np.arange(6) * math.pi / 3.0:
        x, y, z = (math.cos(angle) * t + math.sin(angle) * (math.cos(side) * u + math.sin(side) * v)).tolist()
        found.append((x, y, z))
    return found


def main() -> None:
    times()
    closed_form_length()
    arcs()
    catenaries()
    by_turn, by_length = growth()
    for x, row in zip(TURNS, by_turn, strict=True):
        if x in (0, 1, 2, 5, 10):
            print(f"directions off by {x:g} deg: {row[0]:.2f} mm mean, {row[1]:.2f} mm at worst")
    for x, row in zip(STRETCHES, by_length, strict=True):
        if x in (-2, -1, 1, 2, 3):
            print(f"length off by {x:g} %: {row[0]:.2f} mm mean, {row[1]:.2f} mm at worst")
    noise()
    if len(sys.argv) > 1:
        plot(Path(sys.argv[1]), by_turn, by_length)


if __name__ == "__main__":
    main()
