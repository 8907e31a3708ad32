"""The branch of equilibria that counts: against shooting with ramps, and refined before a refusal."""

from __future__ import annotations

import numpy as np
import pytest

from contid.kinematics.cosserat.branch import Station, critical_factor, equilibrium, follow
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.search import fine_equilibrium
from tests.kinematics.cosserat_cases import GRAM, hanging, two
from tests.oracles.rod_shooting import ramped_tip


@pytest.mark.parametrize("seed", range(3))
def test_the_branch_is_that_of_shooting_with_a_ramp(seed: int) -> None:
    """DOP853 in quaternions, pressures and force raised together in equal steps; 10 g in any direction."""
    rng = np.random.default_rng(seed)
    pressures, force = rng.uniform(0.0, 1.5, 6), rng.normal(size=3)
    force *= 10.0 * GRAM / np.linalg.norm(force)
    found, _ = fine_equilibrium(two(), pressures, Loads(tip_force=force), 12, 1e-4)
    assert found.done == 1.0
    oracle = ramped_tip(two(), pressures, force)
    assert oracle is not None
    assert np.linalg.norm(found.sweep.tip - oracle) < 1e-3


def test_the_order_of_pressures_and_load_makes_no_difference_without_a_fold() -> None:
    rod, loads = two(), hanging(10.0)
    pressures = np.array([1.2, 0.1, 0.4, 0.2, 1.4, 0.3])
    empty = Station(np.zeros(6), loads.scaled(0.0))
    together = equilibrium(rod, pressures, loads)
    for between in (Station(pressures, loads.scaled(0.0)), Station(np.zeros(6), loads)):
        first = follow(rod, empty, between, np.zeros(3), 3)
        second = follow(rod, between, Station(pressures, loads), first.base_moment, 3)
        assert first.done == second.done == together.done == 1.0
        assert np.abs(second.base_moment - together.base_moment).max() < 1e-6


def test_a_branch_ends_where_the_arm_buckles() -> None:
    """Upright: the part done is the critical part of load and pressures raised together."""
    rod, pressures = two(), np.full(6, 0.5)
    loads = Loads(tip_force=np.array([0.0, 0.0, -4.0 * GRAM]))
    end = equilibrium(rod, pressures, loads)
    assert 0.5 < end.done < 1.0
    part = end.done
    factor = critical_factor(rod, part * pressures, loads)
    assert factor == pytest.approx(part, rel=0.02)


def test_stable_and_critical_load_do_not_rest_on_three_elements() -> None:
    """Sideways loads at which three elements count an unstable mode that twelve do not have."""
    rod, rng, differ = two(), np.random.default_rng(0), 0
    for _ in range(40):
        pressures, force = rng.uniform(0.0, 1.5, 6), rng.normal(size=3)
        loads = Loads(tip_force=0.4 * force / np.linalg.norm(force))
        if equilibrium(rod, pressures, loads).done == 1.0:
            continue
        fine = equilibrium(rod, pressures, loads, 24)
        if fine.done < 1.0:
            continue
        differ += 1
        assert fine_equilibrium(rod, pressures, loads, 3, 0.03)[0].done == 1.0
        assert critical_factor(rod, pressures, loads) is None
        if differ == 2:
            return
    pytest.fail("no load with another verdict at three elements was found")
