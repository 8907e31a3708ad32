"""The closed forms for two sections: golden values, round trips through rigid pieces and past half a turn."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from contid.kinematics.arc.sections import Sections
from studies.arc_chains import biarc, lengths_of
from tests.kinematics.section_robots import GOLDEN, PAPER, RACKS, cbha_sections, free_solver, placed

BIARC = GOLDEN["biarc"]


@pytest.mark.parametrize(("leg_mm", "lengths"), [(BIARC["a"], BIARC["l"]), (60.0, BIARC["l_at_a60"])])
def test_biarcs_of_the_reference(leg_mm, lengths):
    arcs = biarc(np.array(BIARC["p"]) / 1e3, np.array(BIARC["t"]), leg_mm / 1e3, (0.0, 0.0))
    np.testing.assert_allclose(lengths_of(cbha_sections(PAPER), np.array(arcs)) * 1e3, lengths, atol=1e-10)


bends = st.tuples(st.floats(0.05, 5.8), st.floats(-3.1, 3.1), st.floats(0.05, 0.6))


@settings(max_examples=100, deadline=None)
@given(bends, bends, st.floats(0.0, 0.1), st.floats(0.0, 0.1))
def test_the_family_contains_every_pair_of_arcs(first, second, between, after):
    """For the control leg of the first arc the biarc through tip and tangent is that pair again."""
    # At half a turn the leg is infinite; near a closed loop position and tangent determine little.
    assume(all(abs(theta - math.pi) > 0.1 for theta, _, _ in (first, second)))
    arcs = np.array([(t * math.cos(a), t * math.sin(a), L) for t, a, L in (first, second)])
    sections = Sections((0.035, 0.035), (RACKS, RACKS), (between, after))
    tip, frame = placed(sections, lengths_of(sections, arcs))
    leg1, leg2 = (L / t * math.tan(0.5 * t) for t, _, L in (first, second))
    assume(abs(leg1 + leg2 + between) > 0.05)
    below = tip @ frame[:, 2] - after + leg1 * (1 - frame[2, 2]) + between
    assume(abs(below) > 0.02)
    found = biarc(tip, frame[:, 2], leg1, (between, after))
    assert found is not None
    reached, turned = placed(sections, lengths_of(sections, np.array(found)))
    np.testing.assert_allclose(reached, tip, atol=1e-8)
    np.testing.assert_allclose(turned[:, 2], frame[:, 2], atol=1e-8)
    np.testing.assert_allclose(found, arcs, atol=1e-6)


@settings(max_examples=50, deadline=None)
@given(bends, bends, st.floats(0.0, 0.1), st.floats(0.0, 0.1))
def test_two_arcs_through_mid_point_and_tip(first, second, between, after):
    for theta, _, length in (first, second):  # not where the end comes back to its start
        rigid = between if theta == first[0] else after
        assume(abs(math.sin(theta / 2) / theta * length + rigid / 2 * math.cos(theta / 2)) > 0.02)
    arcs = np.array([(t * math.cos(a), t * math.sin(a), L) for t, a, L in (first, second)])
    sections = Sections((0.035, 0.035), (RACKS, RACKS), (between, after))
    solver = free_solver(sections)
    at = solver.forward(tuple(lengths_of(sections, arcs).tolist()))
    found = solver.solve(at.tip, None, at.mid, (0.3,) * 6)
    assert found.starts == 0
    np.testing.assert_allclose(sections.arcs(found.lengths), arcs, atol=1e-8)


@pytest.mark.parametrize(
    ("points_mm", "least", "greatest", "turn_deg", "radius_mm"),
    [
        ([(-150, 0, 300), (150, 0, 300)], 293.959, 380.191, 53.13, 375.0),
        ([(-120, -120, 250), (120, 120, 350)], 276.981, 424.855, 68.34, 269.0),
        ([(120, 120, 300), (-120, 120, 300), (-120, -120, 300), (120, -120, 300), (120, 120, 300)],
         304.405, 395.191, 58.99, 350.0),
    ],
)  # fmt: skip
def test_the_papers_paths_with_one_segment(points_mm, least, greatest, turn_deg, radius_mm):
    """Traverse, diagonal and corners of the reference: range of the racks, greatest bend, least radius."""
    sections = Sections((0.035,), (RACKS,), (0.0,))
    path = np.concatenate([np.linspace(a, b, 2001) for a, b in itertools.pairwise(points_mm)])
    solver = free_solver(sections)
    answers = [solver.solve((x, y, z), None, None, (0.3,) * 3) for x, y, z in (path / 1e3).tolist()]
    assert all(answer.starts == 0 for answer in answers)
    lengths = np.array([answer.lengths for answer in answers])
    arcs = sections.arcs(lengths)[:, 0, :]
    lengths = 1e3 * lengths
    assert np.min(lengths) == pytest.approx(least, abs=2e-3)
    assert np.max(lengths) == pytest.approx(greatest, abs=2e-3)
    theta = np.hypot(arcs[:, 0], arcs[:, 1])
    assert math.degrees(theta.max()) == pytest.approx(turn_deg, abs=6e-3)
    radius = arcs[:, 2] / np.maximum(theta, 1e-12) * 1e3
    assert radius.min() == pytest.approx(radius_mm, abs=0.06)
