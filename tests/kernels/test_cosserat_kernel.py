"""The pneumatic rod's kernel against its specification in NumPy, to the last digits."""

from __future__ import annotations

import dataclasses
import importlib
import sys
import threading

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from contid.kernels import has_avx2, load
from contid.kinematics.cosserat.engine import NumpyEngine, RodSetup, RodSolver
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.section import Rod
from tests.kinematics.cosserat_cases import GRAM, lean, limits, section
from tests.oracles.bounded import models

pytestmark = pytest.mark.skipif(
    load("cosserat") is None, reason="the kernel is not built, or CONTID_PURE_PYTHON is set"
)


def setup(sections: int, weighs: bool = False, tip_link: float = 0.0, **changes: object) -> RodSetup:
    parts = tuple(
        section(i % 2, 5.0 if i < sections - 1 else tip_link, first_pair_rad=0.3 * i) for i in range(sections)
    )
    w = np.array([1e-4, -2e-4, 1e-3])
    weight = Loads(weight=dict.fromkeys(range(sections), w), link_weight={0: 2.0 * w}) if weighs else Loads()
    whole = RodSetup(Rod(parts), weight, limits(sections), 3, 1e9, 1e-7, 42.0, False, thorough=False)
    return dataclasses.replace(whole, **changes)  # type: ignore[arg-type]


def both(setup: RodSetup) -> tuple[RodSolver, RodSolver]:
    kernel = load("cosserat")
    assert kernel is not None
    return NumpyEngine(setup), kernel.Engine(setup)


PRESSURES = st.lists(st.floats(0.0, 1.5), min_size=12, max_size=12)
FORCES = st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-0.01, 0.1))


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 4), st.booleans(), st.sampled_from([0.0, 3.0]), PRESSURES, FORCES)
def test_forward(
    sections: int, weighs: bool, tip_link: float, pressures: list[float], force: tuple[float, float, float]
) -> None:
    if sections > 2:
        # Long arms under load have many equilibria, where the two may follow different ones.
        force, weighs = (0.05 * force[0], 0.05 * force[1], 0.05 * force[2]), False
    numpy, kernel = both(setup(sections, weighs, tip_link))
    p = pressures[: 3 * sections]
    a, b = numpy.forward(p, force), kernel.forward(p, force)
    assert a[3] == b[3]
    if a[3]:
        for one, other in zip((*a[:3], a[4]), (*b[:3], b[4]), strict=True):
            assert np.abs(np.array(one) - other).max() < 1e-8


@settings(max_examples=20, deadline=None)
@example(1, False, "a", [1.0, 1.0, 0.9375] + 9 * [0.0], 6e-8)
@given(st.integers(1, 2), st.booleans(), st.sampled_from("abc"), PRESSURES, st.floats(0.0, 5.0))
def test_inverse(sections: int, weighs: bool, mode: str, pressures: list[float], grams: float) -> None:
    """Reachable targets, started from near the pressures that reach them."""
    numpy, kernel = both(setup(sections, weighs, tolerance=1e-6))
    force = (0.0, 0.0, grams * GRAM)
    p = pressures[: 3 * sections]
    tip, R, mid, stable, _, _ = kernel.forward(p, force)
    if not stable:
        return
    two = sections == 2
    given_mid = mid if two and mode == "b" else None
    direction = (R[2], R[5], R[8]) if two and mode == "c" else None
    seed = [0.9 * x + 0.05 for x in p]
    a = numpy.inverse(tip, given_mid, direction, force, seed)  # type: ignore[arg-type]
    b = kernel.inverse(tip, given_mid, direction, force, seed)  # type: ignore[arg-type]
    assert a[2]
    assert b[2]
    assert a[4] == b[4]
    if given_mid is not None or not two:
        assert np.abs(np.array(a[0]) - b[0]).max() < 1e-6


@settings(max_examples=20, deadline=None)
@given(st.integers(1, 2), PRESSURES, st.floats(-15.0, -4.0))
def test_next_to_no_load(sections: int, pressures: list[float], decade: float) -> None:
    """Where rounding is more than parts of the load, the answer is that of no load."""
    p = [0.1 + 0.8 * x for x in pressures[: 3 * sections]]
    for engine in both(setup(sections, tolerance=1e-6)):
        tip, _, mid, *_ = engine.forward(p, (0.0, 0.0, 0.0))
        force = (0.0, 0.0, 10.0**decade * GRAM)
        reached = engine.forward(p, force)
        assert reached[3]
        assert np.abs(np.array(reached[0]) - tip).max() < 100.0 * 10.0**decade + 1e-9
        seed = [0.9 * x + 0.05 for x in p]
        answer = engine.inverse(tip, mid if sections == 2 else None, None, force, seed)  # type: ignore[arg-type]
        assert answer[2]
        assert answer[4]


def test_out_of_reach_ends_at_the_same_bounds() -> None:
    numpy, kernel = both(setup(2))
    for force in ((0.0, 0.0, 0.0), (0.0, 0.0, 5 * GRAM)):
        a = numpy.inverse((-20.0, 15.0, 120.0), (8.0, -5.0, 60.0), None, force, [0.5] * 6)
        b = kernel.inverse((-20.0, 15.0, 120.0), (8.0, -5.0, 60.0), None, force, [0.5] * 6)
        assert not b[2]
        assert b[3]
        assert b[7] < 1e-9
        assert b[1] == pytest.approx(a[1], abs=1e-6)
        assert np.abs(np.array(a[0]) - b[0]).max() < 1e-4


def test_a_thorough_search_finds_the_same_nearest_pose() -> None:
    numpy, kernel = both(setup(1, True, thorough=True))
    arguments = ((30.0, -22.0, -5.0), None, None, (0.004, 0.0, 0.03), [0.5] * 3)
    a, b = numpy.inverse(*arguments), kernel.inverse(*arguments)
    assert not b[2]
    assert a[1:] == pytest.approx(b[1:], rel=1e-9)
    assert a[0] == pytest.approx(b[0], abs=1e-9)


def test_a_short_search_with_more_elements_finds_the_same_nearest_pose() -> None:
    """A tilted arm with own weight that needs more than three elements."""
    numpy, kernel = both(models()[1].for_ticks().setup)
    seed = [0.764, 0.5038, 0.7511, 1.2702, 1.217, 0.6399]
    arguments = ((-4.9202, -60.1073, -11.1217), None, None, (0.0246, -0.0147, 0.0398), seed)
    a, b = numpy.inverse(*arguments), kernel.inverse(*arguments)
    assert not b[2]
    assert b[6] > 3
    assert a[1] == pytest.approx(b[1], rel=1e-9)
    assert a[0] == pytest.approx(b[0], abs=1e-6)


@pytest.mark.parametrize("degrees", [0.0, 20.0])
def test_redundancy_is_resolved_alike(degrees: float) -> None:
    numpy, kernel = both(setup(2, tolerance=1e-6))
    tip = np.array([20.0, -15.0, 118.0])
    t = lean(tip, degrees)
    for grams in (0.0, 5.0):
        arguments = (tuple(tip), None, tuple(t), (0.0, 0.0, grams * GRAM), [0.7] * 6)
        a, b = numpy.inverse(*arguments), kernel.inverse(*arguments)
        assert a[2]
        assert b[2]
        assert np.abs(np.array(a[0]) - b[0]).max() < 1e-3


@pytest.mark.parametrize("weighs", [False, True])
@pytest.mark.parametrize("degrees", [None, 20.0])
@pytest.mark.parametrize("grams", [0.0, 5.0])
def test_redundant_answers_along_a_path_are_alike(weighs: bool, degrees: float | None, grams: float) -> None:
    """The kernel follows a path by fewer sweeps, to the same nearest pressures; asked again, they stay."""
    numpy, kernel = both(setup(2, weighs, tolerance=1e-6))
    force = (0.0, 0.0, grams * GRAM)
    seed: tuple[float, ...] = (0.7,) * 6
    for k in range(4):
        tip = np.array([20.0 - 0.3 * k, -15.0 + 0.4 * k, 118.0 - 0.1 * k])
        direction = None if degrees is None else tuple(lean(tip, degrees).tolist())
        a, b = (engine.inverse(tuple(tip), None, direction, force, seed) for engine in (numpy, kernel))
        assert a[2]
        assert b[2]
        seed = b[0]
        if k:  # the first one comes from afar
            assert np.abs(np.array(a[0]) - b[0]).max() < 1e-6
            again = kernel.inverse(tuple(tip), None, direction, force, seed)
            assert np.abs(np.array(again[0]) - b[0]).max() < 2e-7


def test_critical_factors() -> None:
    numpy, kernel = both(setup(2))
    for bar in (0.0, 0.5):
        a = numpy.critical([bar] * 6, (0.0, 0.0, -30 * GRAM), 1.0)
        b = kernel.critical([bar] * 6, (0.0, 0.0, -30 * GRAM), 1.0)
        assert a is not None
        assert b == pytest.approx(a, rel=1e-6)
    assert kernel.critical([0.5] * 6, (0.0, 0.0, 10 * GRAM), 1.0) is None


def test_bad_calls_are_errors_not_crashes() -> None:
    _, kernel = both(setup(2))
    with pytest.raises(ValueError, match="three pressures per section"):
        kernel.inverse((0.0, 0.0, 100.0), None, None, (0.0, 0.0, 0.0), [0.5] * 3)
    with pytest.raises(TypeError):
        kernel.inverse(("a", 0.0, 0.0), None, None, (0.0, 0.0, 0.0), [0.5] * 6)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="three numbers"):
        kernel.inverse((0.0, 0.0), None, None, (0.0, 0.0, 0.0), [0.5] * 6)  # type: ignore[arg-type]
    for tip in ((float("nan"), 0.0, 100.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1e300), (1e300, 0.0, 0.0)):
        answer = kernel.inverse(tip, None, None, (0.0, 0.0, 0.0), [0.5] * 6)
        assert not answer[2]
        assert all(0.0 <= p <= 1.5 for p in answer[0])
    huge = kernel.inverse((0.0, 0.0, 100.0), None, None, (1e3, 0.0, 0.0), [0.5] * 6)
    assert not (huge[2] and not huge[4])


def test_the_lock_is_held() -> None:
    """A solve holds the GIL: reacquiring it would cost switch intervals."""
    _, kernel = both(setup(2))
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
            kernel.inverse((-8.0, 12.0, 118.0), None, None, (0.0, 0.0, 0.0), [0.5] * 6)
        assert turns[0] == before
    finally:
        sys.setswitchinterval(usual)
        stop = True
        thread.join()


@pytest.mark.parametrize("grams", [0.0, 5.0])
def test_out_of_reach_no_pressure_helps_further(grams: float) -> None:
    """First-order optimality inside the bounds, by differences; statics to 1e-9 N·mm."""
    _, kernel = both(setup(2, tolerance=1e-6))
    rng = np.random.default_rng(11)
    force, unmet = (0.0, 0.0, grams * GRAM), 0
    for _ in range(25):
        tip = rng.uniform((-40.0, -40.0, 90.0), (40.0, 40.0, 150.0))
        mid = rng.uniform((-20.0, -20.0, 45.0), (20.0, 20.0, 75.0))
        answer = kernel.inverse(tuple(tip), tuple(mid), None, force, [0.5] * 6)
        if answer[2] or not (answer[3] and answer[4]):
            continue
        unmet += 1
        assert answer[7] < 1e-9
        p = np.array(answer[0])

        def cost(at: np.ndarray, tip: np.ndarray = tip, mid: np.ndarray = mid) -> float:
            reached = kernel.forward(at.tolist(), force)
            return float(
                np.sum((np.array(reached[0]) - tip) ** 2) + np.sum((np.array(reached[2]) - mid) ** 2)
            )

        slope = np.array([(cost(p + d) - cost(p - d)) / 2e-5 for d in 1e-5 * np.eye(6)])
        # A pressure at its lower end may want to fall, one at its upper end to rise.
        wrong = np.where(p <= 0.0, np.minimum(slope, 0.0), np.where(p >= 1.5, np.maximum(slope, 0.0), slope))
        assert np.abs(wrong).max() < 0.01 * (answer[1] * 60.0)
    assert unmet > 10


@pytest.mark.skipif(not has_avx2(), reason="this processor has no AVX2")
def test_wide_registers_give_the_same_bits() -> None:
    plain = importlib.import_module("contid.kernels._cosserat")
    wide = importlib.import_module("contid.kernels._cosserat_avx2")
    assert load("cosserat") is wide
    random = np.random.default_rng(3)
    for sections, weighs in ((1, False), (2, False), (2, True), (3, False)):
        described = setup(sections, weighs, error=1e-2, tolerance=1e-4)
        engines = plain.Engine(described), wide.Engine(described)
        for _ in range(40):
            p = random.uniform(0.0, 1.0, 3 * sections).tolist()
            force = (0.0, 0.0, float(random.choice([0.0, 0.02])))
            assert engines[0].forward(p, force) == engines[1].forward(p, force)
            tip = engines[0].forward(p, force)[0]
            seed = [0.95 * x + 0.02 for x in p]
            assert engines[0].inverse(tip, None, None, force, seed) == engines[1].inverse(
                tip, None, None, force, seed
            )


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 2), st.booleans(), PRESSURES, FORCES)
def test_near(sections: int, weighs: bool, pressures: list[float], force: tuple[float, float, float]) -> None:
    """From a guess that is off: twins, and derivatives against differences of whole solutions."""
    numpy, kernel = both(setup(sections, weighs, 3.0, elements=8))
    p = pressures[: 3 * sections]
    tip, _, _, stable, moment, _ = kernel.forward(p, force)
    if not stable:
        return
    guess = [value + 1e-3 for value in moment]
    a, b = numpy.near(p, force, guess), kernel.near(p, force, guess)
    assert (a is None) == (b is None)
    if a is None or b is None:
        return
    assert np.abs(np.array(a[0]) - b[0]).max() < 1e-8
    assert np.abs(np.array(b[0]) - tip).max() < 1e-7
    assert np.abs(np.array(a[1]) - b[1]).max() < 1e-8
    by_force, by_pressure = np.array(b[2]).reshape(3, 3), np.array(b[3]).reshape(3, -1)
    scale = np.abs(by_force).max()
    # Two formulations of the derivative, which differ by the error of the discretisation.
    assert np.abs(np.array(a[2]) - b[2]).max() < 2e-3 * scale
    assert np.abs(by_force - by_force.T).max() < 2e-3 * scale
    assert np.abs(np.array(a[3]) - b[3]).max() < 1e-6 * max(1.0, np.abs(by_pressure).max())
    step = 1e-5 / max(1.0, 1e-3 * scale)
    for axis in range(3):
        ends = []
        for sign in (1.0, -1.0):
            moved = list(force)
            moved[axis] += sign * step
            near = kernel.near(p, (moved[0], moved[1], moved[2]), b[1])
            if near is None:
                return
            ends.append(np.array(near[0]))
        assert np.abs((ends[0] - ends[1]) / (2.0 * step) - by_force[:, axis]).max() < 2e-3 * scale


def test_near_a_guess_too_far_away_there_is_none() -> None:
    numpy, kernel = both(setup(2))
    p = [0.3, 0.5, 0.1, 0.2, 0.6, 0.4]
    for engine in (numpy, kernel):
        assert engine.near(p, (0.0, 0.0, 0.05), (1e4, -1e4, 1e4)) is None
