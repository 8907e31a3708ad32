"""Where the path from rest passes near a fork, `forward` is on the side on which an independent walk is.

The pressures are answers of a search that used to end there: `forward` was 9 to 71 mm from the walk (RK4, own
unknowns and step control, with finer steps too).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from contid.kinematics.cosserat.engine import RodSolver
from contid.targets import Vec3
from contid.units import MM_PER_M
from tests.oracles.bounded import GRAM_N, TILTED, models
from tests.oracles.rod_walk import load_scale, walk

Case = tuple[int, int, tuple[float, ...], Vec3]

#: Arm of `models`, mass on the tip [g], pressures [bar], and where the walk ends [mm], which takes seconds:
#: the campaign walks again.
BESIDE: list[Case] = [
    (0, 5, (1.003258, 0.000126, 1.252239, 1.5, 0.0, 1.499665), (-42.8082, 13.4429, 45.6126)),
    (1, 5, (1.144067, 0.0, 0.097466, 1.5, 0.0, 0.624809), (-24.7536, -33.2196, 86.4631)),
    (1, 5, (1.134369, 0.0, 0.0, 1.5, 0.0, 0.593255), (-26.5407, -27.621, 87.6497)),
    (1, 5, (1.152915, 0.025759, 0.0, 1.5, 0.0, 0.588011), (-25.974, -33.4661, 85.4711)),
    (1, 5, (1.154274, 0.0, 0.0, 1.5, 0.0, 0.595937), (-23.6181, -43.2442, 79.2002)),
    (1, 5, (1.164572, 0.0, 1.5, 1.355748, 0.0, 0.419944), (53.9705, 38.2533, 80.1498)),
    (1, 10, (1.5, 0.0, 0.001226, 0.978395, 0.0, 0.841241), (1.2271, -48.0809, 94.3288)),
    (1, 10, (1.46107, 0.0, 1.5, 1.207031, 0.0, 0.0), (60.5002, 14.0615, 83.8746)),
    (1, 10, (1.390811, 0.0, 1.5, 1.272027, 0.0, 0.121586), (58.4892, 16.1127, 88.777)),
    (1, 10, (1.362657, 0.0, 1.476619, 1.227382, 0.0, 0.0), (46.5061, 17.8766, 97.8512)),
]
#: Distance of two tips that are one pose [mm].
SAME_MM = 0.3
#: Pressures [bar] and loads [N] nearly along the arm. Here the walk goes on and contid did not: points before
#: the last were in balance to a part of the load, too inexactly for an arm that is this soft, and the steps
#: were not short enough for one that swings as fast.
SWINGING: list[tuple[tuple[float, ...], Vec3]] = [
    ((0.69319, 0.67224, 0.70496, 0.67873, 0.69506, 0.69168), (7e-05, -0.002006, -0.272046)),
    ((1.27118, 1.25566, 1.27146, 1.24268, 1.27794, 1.27909), (7e-05, -0.002006, -0.272046)),
    ((0.19705, 0.18045, 0.21286, 0.18254, 0.199, 0.17173), (-5e-05, -0.003508, -0.339251)),
    ((1.34823, 1.33631, 1.32125, 1.35208, 1.32523, 1.35492), (0.004003, 0.001935, -0.185623)),
]


#: Pressures [bar] and a load [N] that grows at them.
PRESSED: tuple[tuple[float, ...], Vec3] = (
    (1.034920, 0.836863, 1.104173, 0.970777, 0.042801, 1.241330), (0.095485, -0.212212, -0.215818)
)  # fmt: skip
#: Ends of a path under 5 g [bar], and the part of it that the walk gets along.
SNAP_BEGIN = (0.4307, 1.372, 1.423, 0.942, 0.4155, 0.0074)
SNAP_END = (4e-05, 1.44942, 1.49997, 0.03045, 1.19824, 1.4621)
SNAP_PART = 0.92661


def load_of(number: int, grams: int) -> Vec3:
    down = np.array(TILTED) / np.linalg.norm(TILTED) if number else np.array([0.0, 0.0, 1.0])
    x, y, z = (grams * GRAM_N * down).tolist()
    return x, y, z


def test_forward_is_on_the_side_of_the_walk() -> None:
    arms = models()
    for number, grams, bar, walked_tip in BESIDE:
        found = arms[number].engine.forward(bar, load_of(number, grams))
        assert found.stable
        assert float(np.linalg.norm(np.array(found.tip_mm) - walked_tip)) < SAME_MM
        # The same by the model, in metres.
        pose = arms[number].forward(tuple(1e5 * p for p in bar), load_of(number, grams))
        assert pose.stable
        assert float(np.linalg.norm(MM_PER_M * np.array(pose.tip_m) - walked_tip)) < SAME_MM


@pytest.mark.campaign
@pytest.mark.parametrize("arm", sorted({case[:2] for case in BESIDE}))
def test_the_walk_ends_there(arm: tuple[int, int]) -> None:
    cases = [case for case in BESIDE if case[:2] == arm]
    setup = models()[arm[0]].setup
    loads = setup.loads(load_of(*arm))
    walked = walk(setup.rod, loads, load_scale(setup.rod, loads), np.array([bar for _, _, bar, _ in cases]))
    assert walked.there.all()
    assert walked.tip == pytest.approx(np.array([tip for *_, tip in cases]), abs=1e-3)


@pytest.mark.campaign
@pytest.mark.parametrize(("bar", "force"), SWINGING)
def test_an_arm_that_swings_fast_is_followed(bar: tuple[float, ...], force: Vec3) -> None:
    setup = models()[0].setup
    loads = setup.loads(force)
    walked = walk(setup.rod, loads, load_scale(setup.rod, loads), np.array([bar]))
    assert walked.there.all()
    found = models()[0].engine.forward(bar, force)
    assert found.stable
    assert float(np.linalg.norm(np.array(found.tip_mm) - walked.tip[0])) < SAME_MM


def test_a_point_far_from_its_prediction_is_another_equilibrium() -> None:
    """The load grows at constant pressures; a step that went 148 mm led to where the arm buckles."""
    bar, force = PRESSED
    assert models()[0].critical_load_n(tuple(1e5 * p for p in bar), force) is None


@pytest.mark.campaign
def test_the_walk_carries_that_load() -> None:
    bar, force = PRESSED
    setup = models()[0].setup
    rod, loads = setup.rod, setup.loads(force)
    assert walk(rod, loads, load_scale(rod, loads), np.array([bar]), pressed=True).there.all()


def test_a_path_does_not_step_over_a_snap() -> None:
    """Under 5 g: a parabola pointed at another branch, and the path went on there.

    The pose at the end of the path is the target, by tip and mid-point, so that no other pressures meet it.
    """
    force = load_of(0, 5)
    engine = RodSolver(replace(models()[0].setup, elements=12, error=1e9))
    there = engine.forward(SNAP_END, force)
    assert there.stable
    found = engine.inverse(there.tip_mm, there.mid_mm, None, force, SNAP_BEGIN)
    assert not found.met
    assert found.snap == pytest.approx(SNAP_PART, abs=1e-3)
    assert found.snap < 0.93
    rested = engine.inverse(there.tip_mm, there.mid_mm, None, force, [0.0] * 6)
    assert rested.met


@pytest.mark.campaign
def test_the_walk_snaps_there() -> None:
    begin, setup = np.array([SNAP_BEGIN]), models()[0].setup
    rod, loads = setup.rod, setup.loads(load_of(0, 5))
    scale = load_scale(rod, loads)
    stands = walk(rod, loads, scale, begin)
    walked = walk(rod, loads, scale, np.array([SNAP_END]), begin=(begin, stands.moment))
    assert float(walked.done[0]) == pytest.approx(SNAP_PART, abs=1e-4)
