"""Rows of a pneumatic arm: unloaded against products of exponentials, loaded as single calls bit for bit.

Unloaded rows have their own sweep, in which a section is an arc.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import expm

from contid.kinematics.array import Array
from contid.kinematics.batch.kernel import in_bytes
from contid.kinematics.batch.rows import POSE, Table, solution_dtype
from contid.kinematics.cosserat.engine import RodSolver
from contid.kinematics.cosserat.section import Rod
from contid.targets import ZERO3, Vec3
from tests.kinematics.cosserat_cases import GRAM, section, solver

ROWS = 6
#: Bits of `limited_by`.
OPTIMAL, STABLE, BLOCKED, SNAPS = 1, 2, 4, 8


def rod_of(sections: int, tip_link: float) -> Rod:
    links = [5.0] * (sections - 1) + [tip_link]
    return Rod(tuple(section(i % 2, link, first_pair_rad=0.3 * i) for i, link in enumerate(links)))


def frames_by_exponentials(rod: Rod, bar: Array) -> list[Array]:
    """Homogeneous frames of every section's end and of the tip: without a load strains are constant."""
    frame, found = np.eye(4), []
    for i, each in enumerate(rod.sections):
        p = bar[3 * i : 3 * i + 3]
        modulus = each.modulus(float(p.mean()))[0]
        x, y, _ = each.pair_moment @ p / (modulus * each.inertia)
        stretch = 1.0 + each.pair_force * float(p.sum()) / (modulus * each.area)
        twist = np.array(
            [[0.0, 0.0, y, 0.0], [0.0, 0.0, -x, 0.0], [-y, x, 0.0, stretch], [0.0, 0.0, 0.0, 0.0]]
        )
        frame = frame @ expm(each.length * twist)
        found.append(frame)
        frame = frame @ np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, each.link], [0, 0, 0, 1]])
    return [*found, frame]


def solved(
    engine: RodSolver, tips: Array, mids: Array | None, directions: Array | None, loads: Array | None,
    seeds: Array, threads: int = 1,
) -> Table:  # fmt: skip
    found = np.zeros(len(tips), solution_dtype(seeds.shape[1]))
    engine.inverse_many(tips, mids, directions, loads, seeds, in_bytes(found), threads)
    return found


def vec3(row: Array) -> Vec3:
    x, y, z = row.tolist()
    return x, y, z


@pytest.mark.parametrize("elements", [1, 3])
@pytest.mark.parametrize(("sections", "tip_link"), [(1, 0.0), (2, 0.0), (2, 3.0), (3, 3.0)])
def test_unloaded_rows_reach_their_targets_by_exponentials(
    sections: int, tip_link: float, elements: int
) -> None:
    """Strong bends, so that an element turns by more than a radian; links, and sections of two kinds."""
    rod = rod_of(sections, tip_link)
    engine = solver(rod, elements=elements, tolerance=1e-9 if sections < 3 else 1e-6)
    pressures = np.random.default_rng(sections).uniform(0.0, 1.5, (ROWS, 3 * sections))
    frames = [frames_by_exponentials(rod, row) for row in pressures]
    tips, mids = np.array([f[-1][:3, 3] for f in frames]), np.array([f[0][:3, 3] for f in frames])
    unique = sections < 3
    seeds = np.clip(0.9 * pressures + 0.05, 0.0, 1.5)
    found = solved(engine, tips, mids if sections == 2 else None, None, None, seeds)
    assert found["converged"].all()
    for k, row in enumerate(found):
        assert row["limited_by"] == OPTIMAL | STABLE
        assert np.abs(frames_by_exponentials(rod, row["actuation"])[-1][:3, 3] - tips[k]).max() < 1e-8
        assert 1 <= row["iterations"] <= 8 or not unique
        if unique:
            assert np.abs(row["actuation"] - pressures[k]).max() < 1e-9
        single = engine.inverse(
            vec3(tips[k]), vec3(mids[k]) if sections == 2 else None, None, ZERO3, seeds[k].tolist()
        )
        assert single.met
        assert single.pressures_bar == pytest.approx(row["actuation"].tolist(), abs=1e-6)
        assert abs(single.iterations - row["iterations"]) <= 1


@pytest.mark.parametrize("sections", [1, 2, 3, 5, 8])
def test_unloaded_poses_are_products_of_exponentials(sections: int) -> None:
    for elements in (1, 2, 3, 5):
        rod = rod_of(sections, 3.0)
        engine = solver(rod, elements=elements)
        pressures = np.random.default_rng(sections).uniform(-0.1, 2.1, (3, 3 * sections))
        poses = np.zeros(3, POSE)
        engine.forward_many(pressures, None, in_bytes(poses), 1)
        assert poses["stable"].all()
        for row, pose in zip(pressures, poses, strict=True):
            mid, *_, tip = frames_by_exponentials(rod, row)
            assert pose["tip_m"] == pytest.approx(tip[:3, 3], abs=1e-10)
            assert pose["mid_m"] == pytest.approx(mid[:3, 3], abs=1e-11)
            assert pose["rotation"] == pytest.approx(tip[:3, :3], abs=1e-12)
            assert pose["direction"].tolist() == pose["rotation"][:, 2].tolist()
            single = engine.forward(row.tolist(), ZERO3)
            assert single.tip_mm == tuple(pose["tip_m"].tolist())
            assert single.rotation == tuple(pose["rotation"].ravel().tolist())
            assert single.mid_mm == tuple(pose["mid_m"].tolist())


@pytest.mark.parametrize("threads", [pytest.param(1, marks=pytest.mark.campaign), 3])
def test_rows_under_loads_are_those_of_single_calls(threads: int) -> None:
    """More rows than a thread takes at once; some out of reach, some that buckle, some on another branch."""
    engine, rng, rows = solver(rod_of(2, 0.0)), np.random.default_rng(6), 110
    loads = rng.normal(size=(rows, 3)) * 0.02
    loads[::5] = [0.0, 0.0, -10.0 * GRAM]
    pressures = rng.uniform(0.0, 1.5, (rows, 6))
    pressures[::10] = 0.5  # straight and upright
    poses = np.zeros(rows, POSE)
    engine.forward_many(pressures, loads, in_bytes(poses), threads)
    for row, load, pose in zip(pressures, loads, poses, strict=True):
        single = engine.forward(row.tolist(), vec3(load))
        assert single.tip_mm == tuple(pose["tip_m"].tolist())
        assert single.rotation == tuple(pose["rotation"].ravel().tolist())
        assert single.stable == pose["stable"]
    assert not poses["stable"].all()
    tips = poses["tip_m"].copy()
    tips[::4] *= 1.5
    few = slice(0, rows if threads > 1 else 70)
    found = solved(engine, tips[few], None, None, loads[few], np.full((rows, 6), 0.4)[few], threads)
    for k, row in enumerate(found):
        answer = engine.inverse(vec3(tips[k]), None, None, vec3(loads[k]), [0.4] * 6)
        assert answer.pressures_bar == tuple(row["actuation"].tolist())
        assert answer.residual_mm == row["residual_m"]
        assert answer.met == row["converged"]
        assert answer.iterations == row["iterations"]
        bits = OPTIMAL * answer.optimal | STABLE * answer.stable | BLOCKED * answer.blocked
        assert row["limited_by"] == bits | (SNAPS if answer.snap < 2.0 else 0)
    if threads > 1:  # all rows
        seen = set(found["limited_by"].tolist())
        assert any(bits & BLOCKED for bits in seen)
        assert any(not bits & OPTIMAL for bits in seen)


def test_unloaded_rows_with_a_direction_are_solved_as_single_calls() -> None:
    for full in (False, True):
        engine, rng = solver(rod_of(2, 3.0), full_rotation=full), np.random.default_rng(2)
        pressures = rng.uniform(0.1, 1.2, (ROWS, 6))
        if full:
            pressures[:] = [0.6, 0.6, 0.6, 0.9, 0.9, 0.9]  # straight: no roll is wrong
        frames = [frames_by_exponentials(engine.setup.rod, row)[-1] for row in pressures]
        tips = np.array([frame[:3, 3] for frame in frames])
        directions = np.array([frame[:3, 2] for frame in frames])
        found = solved(engine, tips, None, directions, None, np.full((ROWS, 6), 0.5))
        assert found["converged"].all()
        for k, row in enumerate(found):
            single = engine.inverse(vec3(tips[k]), None, vec3(directions[k]), ZERO3, [0.5] * 6)
            same = 1e-4 if full else 1e-6  # lengths of straight sections are exchanged freely
            assert single.pressures_bar == pytest.approx(row["actuation"].tolist(), abs=same)
            reached = frames_by_exponentials(engine.setup.rod, row["actuation"])[-1]
            assert reached[:3, 3] == pytest.approx(tips[k], abs=2e-6)
            assert reached[:3, 2] == pytest.approx(directions[k], abs=1e-7)


def test_arrays_of_other_shapes_are_refused_by_name() -> None:
    engine = solver(rod_of(2, 0.0))
    tips, seeds = np.full((2, 3), 50.0), np.zeros((2, 6))
    poses, rows = in_bytes(np.zeros(2, POSE)), in_bytes(np.zeros(2, solution_dtype(6)))
    few = np.zeros((2, 3))
    calls: list[tuple[Callable[[], object], str]] = [
        (lambda: engine.inverse_many(few[:, :2].copy(), None, None, None, seeds, rows, 1), "tip: an array"),
        (lambda: engine.inverse_many(tips[:1], None, None, None, seeds, rows, 1), "tip: an array"),
        (lambda: engine.inverse_many(tips, tips[:1], None, None, seeds, rows, 1), "mid: an array"),
        (lambda: engine.inverse_many(tips, None, tips[:1], None, seeds, rows, 1), "direction: an array"),
        (lambda: engine.inverse_many(tips, None, None, tips[:1], seeds, rows, 1), "load: an array"),
        (lambda: engine.inverse_many(tips, None, None, None, few, rows, 1), "three pressures"),
        (lambda: engine.inverse_many(tips, None, None, None, seeds[:1], rows, 1), "three pressures"),
        (lambda: engine.inverse_many(tips, None, None, None, seeds, poses, 1), "layout of the results"),
        (lambda: engine.forward_many(seeds[:1], None, poses, 1), "three pressures"),
        (lambda: engine.forward_many(seeds, tips[:1], poses, 1), "force: an array"),
        (lambda: engine.forward_many(seeds, None, rows, 1), "layout of the results"),
    ]
    for call, message in calls:
        with pytest.raises(ValueError, match=message):
            call()
