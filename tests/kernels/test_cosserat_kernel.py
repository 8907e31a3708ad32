"""The rod's kernel as a module: bad calls, the lock, the same bits on every processor and in every call."""

from __future__ import annotations

import dataclasses
import importlib
import sys
import threading

import numpy as np
import pytest

from contid.kernels import has_avx2, load
from contid.kinematics.cosserat.engine import RodSolver
from contid.kinematics.cosserat.section import Loads
from contid.targets import ZERO3
from tests.kernels.rod_tasks import own_weight, rod_of
from tests.kinematics.cosserat_cases import GRAM, one, solver, two

UNIT = (0.0, 0.0, 100.0)


def test_bad_calls_are_errors_not_crashes() -> None:
    engine = solver(two())
    for call in (
        lambda: engine.inverse(UNIT, None, None, ZERO3, [0.5] * 3),
        lambda: engine.inverse(UNIT, None, None, ZERO3, [0.5] * 7),
        lambda: engine.forward([0.5] * 5, ZERO3),
        lambda: engine.near([0.5] * 5, ZERO3, ZERO3),
        lambda: engine.critical([0.5] * 5, ZERO3, 1.0),
        lambda: engine.statics([0.5] * 5, Loads(), np.zeros(1), np.zeros((1, 12))),
    ):
        with pytest.raises(ValueError, match="three pressures per section"):
            call()
    for bad in ((0.0, 0.0), (0.0, 0.0, 0.0, 0.0)):
        for call in (
            lambda bad=bad: engine.inverse(bad, None, None, ZERO3, [0.5] * 6),
            lambda bad=bad: engine.inverse(UNIT, bad, None, ZERO3, [0.5] * 6),
            lambda bad=bad: engine.inverse(UNIT, None, bad, ZERO3, [0.5] * 6),
            lambda bad=bad: engine.inverse(UNIT, None, None, bad, [0.5] * 6),
            lambda bad=bad: engine.forward([0.5] * 6, bad),
            lambda bad=bad: engine.near([0.5] * 6, ZERO3, bad),
        ):
            with pytest.raises(ValueError, match="three numbers"):
                call()
    with pytest.raises(TypeError):
        engine.inverse(("a", 0.0, 0.0), None, None, ZERO3, [0.5] * 6)  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        engine.forward(0.5, ZERO3)  # type: ignore[arg-type]
    for stations, out in ((np.zeros(2), np.zeros((1, 12))), (np.zeros(1), np.zeros((1, 11)))):
        with pytest.raises(ValueError, match="stations"):
            engine.statics([0.5] * 6, Loads(), stations, out)


def test_numbers_out_of_every_range_have_answers_inside_the_limits() -> None:
    engine = solver(two())
    nan = float("nan")
    for tip in ((nan, 0.0, 100.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1e300), (1e300, 0.0, 0.0), (0.0, 0.0, 1e6)):
        found = engine.inverse(tip, None, None, ZERO3, [0.5] * 6)
        assert not found.met
        assert all(0.0 <= p <= 1.5 for p in found.pressures_bar)
    huge = engine.inverse(UNIT, None, None, (1e3, 0.0, 0.0), [0.5] * 6)
    assert not (huge.met and not huge.stable)
    # A seed outside the limits, or a limit with no room, is no different from one at them.
    for seed in (-1.0, 5.0):
        inside = engine.inverse(
            (5.0, -3.0, 100.0), (1.0, 2.0, 50.0), None, ZERO3, [min(1.5, max(0.0, seed))] * 6
        )
        outside = engine.inverse((5.0, -3.0, 100.0), (1.0, 2.0, 50.0), None, ZERO3, [seed] * 6)
        assert outside.met == inside.met
        assert outside.pressures_bar == pytest.approx(inside.pressures_bar, abs=1e-5)


def test_the_setup_is_read_once() -> None:
    """The kernel has its own copy: what happens to the arrays afterwards makes no difference."""
    setup = solver(two()).setup
    engine = RodSolver(setup)
    before = engine.inverse((-8.0, 12.0, 118.0), None, None, ZERO3, [0.5] * 6)
    setup.limits.upper[:] = 0.1
    setup.limits.centre[:] = 0.05
    assert engine.inverse((-8.0, 12.0, 118.0), None, None, ZERO3, [0.5] * 6) == before


def test_settings_of_the_setup_are_those_of_the_answers() -> None:
    target = (-8.0, 12.0, 118.0), (4.0, -3.0, 60.0), None, (0.0, 0.0, 5.0 * GRAM), [0.5] * 6
    rough, fine = solver(two(), tolerance=0.5), solver(two(), tolerance=1e-8)
    assert rough.inverse(*target).met
    assert fine.inverse(*target).residual_mm <= 1e-8
    assert rough.inverse(*target).iterations < fine.inverse(*target).iterations
    assert solver(two(), elements=5).inverse(*target).elements == 5
    assert solver(two(), error=1e-3).inverse(*target).elements > 3
    # The length that scales directions weighs tip against direction where both cannot be had.
    direction = (0.0, 0.0, -1.0)
    off = []
    for length in (1.0, 42.0, 1000.0):
        engine = solver(two(), direction_length=length)
        found = engine.inverse((20.0, 0.0, 110.0), None, direction, ZERO3, [0.5] * 6)
        at = engine.forward(found.pressures_bar, ZERO3)
        off.append(np.linalg.norm(np.subtract(at.tip_mm, (20.0, 0.0, 110.0))))
        assert not found.met
    assert off[0] < off[1] < off[2]


def test_a_thorough_search_works_more_and_ends_no_farther() -> None:
    target = (30.0, -22.0, -5.0), None, None, (0.004, 0.0, 0.03), [0.5] * 3
    weight = own_weight(1)
    brief, thorough = (solver(one(), weight, thorough=long).inverse(*target) for long in (False, True))
    assert not brief.met
    assert not thorough.met
    assert thorough.stable
    assert thorough.residual_mm <= brief.residual_mm + 1e-6
    assert thorough.iterations > 2 * brief.iterations


def test_the_lock_is_held() -> None:
    """A solve holds the GIL: reacquiring it would cost switch intervals."""
    engine = solver(two())
    turns, stop = [0], False

    def busy() -> None:
        while not stop:
            turns[0] += 1

    thread = threading.Thread(target=busy)
    usual = sys.getswitchinterval()
    thread.start()
    try:
        # From here on the busy thread gets the lock only where it is let go.
        sys.setswitchinterval(5.0)
        before = turns[0]
        for _ in range(20):
            engine.inverse((-8.0, 12.0, 118.0), None, None, ZERO3, [0.5] * 6)
        assert turns[0] == before
    finally:
        sys.setswitchinterval(usual)
        stop = True
        thread.join()


@pytest.mark.skipif(not has_avx2(), reason="this processor has no AVX2")
def test_wide_registers_give_the_same_bits() -> None:
    plain = importlib.import_module("contid.kernels._cosserat")
    wide = importlib.import_module("contid.kernels._cosserat_avx2")
    assert load("cosserat") is wide
    random = np.random.default_rng(3)
    for sections, weighs in ((1, False), (2, False), (2, True), (3, False)):
        described = dataclasses.replace(
            solver(rod_of(sections, 0.0), own_weight(sections) if weighs else None).setup,
            error=1e-2, tolerance=1e-4,
        )  # fmt: skip
        engines = plain.Engine(described), wide.Engine(described)
        for _ in range(40):
            p = random.uniform(0.0, 1.0, 3 * sections).tolist()
            force = (0.0, 0.0, float(random.choice([0.0, 0.02])))
            forward = engines[0].forward(p, force)
            assert forward == engines[1].forward(p, force)
            seed = [0.95 * x + 0.02 for x in p]
            assert engines[0].near(p, force, forward[4]) == engines[1].near(p, force, forward[4])
            assert engines[0].inverse(forward[0], None, None, force, seed) == engines[1].inverse(
                forward[0], None, None, force, seed
            )
