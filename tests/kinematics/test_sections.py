"""Kinematics of constant-curvature sections: golden values, derivatives, tube lengths."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contid.kinematics.arc import arc
from contid.kinematics.arc.sections import Sections, backbone
from studies.arc_chains import lengths_of
from tests.kinematics.section_robots import (
    CCW,
    GOLDEN,
    PAPER,
    RACKS,
    ROBOTS,
    cbha_sections,
    derivatives,
    free_solver,
    placed,
    random_lengths,
)

ONE = Sections((0.035,), (RACKS,), (0.0,))
TWO = Sections((0.035, 0.035), (RACKS, RACKS), (0.0, 0.0))


@pytest.mark.parametrize("golden", GOLDEN["fk"], ids=lambda g: f"{g['layout']}-{g['l'][0]}")
def test_cbha_postures_of_the_reference(golden):
    sections = cbha_sections(PAPER if golden["layout"] == "paper" else CCW)
    tip, rotation = placed(sections, np.array(golden["l"]) / 1e3)
    by_tip, by_spin, _ = derivatives(sections, np.array(golden["l"]) / 1e3)
    np.testing.assert_allclose(tip * 1e3, golden["P"], atol=1e-10)
    np.testing.assert_allclose(rotation, golden["R"], atol=1e-13)
    np.testing.assert_allclose(by_tip, golden["J"], atol=1e-13)
    np.testing.assert_allclose(by_spin / 1e3, golden["Jw"], atol=1e-15)
    arcs = sections.arcs(np.array(golden["l"]) / 1e3)[:, [2, 0, 1]] * (1e3, 1, 1)
    if golden["layout"] == "paper":
        np.testing.assert_allclose(arcs, golden["arc"], atol=1e-12)


@pytest.mark.parametrize(
    ("racks", "tip"),
    [
        ((300, 300, 300), (0, 0, 300)),
        ((50, 50, 50), (0, 0, 50)),
        ((270, 315, 315), (-120.8899766637, 0, 264.5913778014)),
        ((300, 280, 320), (0, -95.4351361101, 278.7002864995)),
        ((340, 300, 260), (147.9501898950, 85.4190819625, 220.2002984594)),
        ((650, 620, 600), (224.1289759429, 97.0506934454, 554.1465527558)),
        ((100, 180, 200), (-105.6650170557, -20.3352420137, 90.2525269448)),
    ],
)
def test_tri_rack_postures_of_the_reference(racks, tip):
    np.testing.assert_allclose(placed(ONE, np.array(racks) / 1e3)[0] * 1e3, tip, atol=6e-11)
    counterclockwise = Sections((0.035,), ((math.pi, math.pi / 3, 5 * math.pi / 3),), (0.0,))
    swapped = np.array((racks[0], racks[2], racks[1])) / 1e3
    np.testing.assert_allclose(placed(counterclockwise, swapped)[0] * 1e3, tip, atol=6e-11)


def test_tri_rack_rotation_and_jacobian_of_the_reference():
    lengths = np.array((340, 300, 260)) / 1e3
    by_tip, _, _ = derivatives(ONE, lengths)
    u, v, S = ONE.arcs(lengths)[0]
    np.testing.assert_allclose((35 * u, 35 * v, 1e3 * S), (40, 23.0940107676, 300), atol=6e-11)
    assert math.hypot(u, v) == pytest.approx(1.3196577581, abs=6e-11)
    rotation = [
        [0.436380229, -0.3254060265, 0.8388582798],
        [-0.3254060265, 0.812126743, 0.4843150537],
        [-0.8388582798, -0.4843150537, 0.248506972],
    ]
    np.testing.assert_allclose(placed(ONE, lengths)[1], rotation, atol=6e-10)
    # By (Dx, Dy, S) instead of racks: d/dDx = (1/rho) d/du.
    by_delta = by_tip @ ONE.to_lengths[0] / (0.035, 0.035, 1.0)
    expected = [
        [2.8692004504, -0.4789433966, 0.4931672997],
        [-0.4789433966, 3.4222366484, 0.2847302732],
        [-2.7309038788, -1.5766880896, 0.7340009949],
    ]
    np.testing.assert_allclose(by_delta, expected, atol=2e-10)


@pytest.mark.parametrize(
    ("racks", "tip"),
    [
        ((300, 280, 320, 250, 260, 240), (0, -213.6270895315, 497.7112941814)),
        ((200, 200, 200, 400, 340, 370), (146.0421892291, -84.3174972645, 512.4825253589)),
    ],
)
def test_two_segments_of_the_reference(racks, tip):
    np.testing.assert_allclose(placed(TWO, np.array(racks) / 1e3)[0] * 1e3, tip, atol=6e-11)


@pytest.mark.parametrize(
    ("tip", "racks"),
    [
        ((120, 120, 300), (385.8641487721, 369.7094650420, 325.5740483114)),
        ((-120, 120, 300), (334.9009593116, 395.1910597723, 351.0556430416)),
        ((-120, -120, 300), (334.9009593116, 351.0556430416, 395.1910597723)),
        ((120, -120, 300), (385.8641487721, 325.5740483114, 369.7094650420)),
        ((150, 0, 300), (380.1910393807, 331.5080404356, 331.5080404356)),
        ((-150, 0, 300), (315.2803741205, 363.9633730656, 363.9633730656)),
        ((150, 0, 500), (549.8818189149, 519.2788554947, 519.2788554947)),
        ((0, -200, 100), (276.7871794485, 209.6698553721, 343.9045035249)),
        ((1e-7, 0, 300), (300.0000000233, 299.9999999883, 299.9999999883)),
    ],
)
def test_closed_form_of_one_segment(tip, racks):
    x, y, z = (value / 1e3 for value in tip)
    found = free_solver(ONE).solve((x, y, z), None, None, (0.3,) * 3)
    assert found.starts == 0
    np.testing.assert_allclose(np.array(found.lengths) * 1e3, racks, atol=6e-11)


@settings(max_examples=200, deadline=None)
@given(
    theta=st.floats(1e-6, 6.2),
    azimuth=st.floats(-3.1, 3.1),
    length=st.floats(0.05, 1.0),
    rigid=st.floats(0.0, 0.2),
)
def test_closed_form_with_a_rigid_tip_is_the_inverse(theta, azimuth, length, rigid):
    u, v = theta * math.cos(azimuth), theta * math.sin(azimuth)
    p, r = arc.pose(np.array(u), np.array(v), np.array(length))
    tip = p + rigid * r[:, 2]
    bent = 0.5 * length * math.sin(theta / 2) / (theta / 2) + rigid * math.cos(theta / 2)
    if abs(bent) < 0.02 * (length + rigid):  # the tip is back at the base: every azimuth reaches it
        return
    sections = Sections((0.035,), (RACKS,), (rigid,))
    found = free_solver(sections).solve((tip[0], tip[1], tip[2]), None, None, (0.3,) * 3)
    assert found.starts == 0
    np.testing.assert_allclose(sections.arcs(found.lengths)[0], (u, v, length), atol=1e-10)


def test_offset_curves_have_the_lengths_of_the_tubes():
    """Integrate the tubes: each is the backbone shifted by its radius in a frame that does not twist."""
    rng = np.random.default_rng(3)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    s, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    for _ in range(20):
        theta, azimuth, length = rng.uniform(0.0, 2.5), rng.uniform(-3.0, 3.0), rng.uniform(0.1, 0.6)
        u, v = theta * math.cos(azimuth), theta * math.sin(azimuth)
        expected = lengths_of(ONE, np.array([(u, v, length)]))
        for tube, angle in enumerate(ONE.angles_rad[0]):
            offset = 0.035 * np.array((math.cos(angle), math.sin(angle), 0.0))

            def place(part, offset=offset, u=u, v=v, length=length):
                p, r = arc.pose(part * u, part * v, part * length)
                return p + r @ offset

            h = 1e-3
            speed = np.linalg.norm(
                8 * (place(s + h) - place(s - h)) - place(s + 2 * h) + place(s - 2 * h), axis=-1
            )
            assert weights @ speed / (12 * h) == pytest.approx(expected[tube], abs=1e-10)


def test_the_pose_of_two_sections_has_five_degrees_of_freedom():
    feasible = ROBOTS["cbha"]()
    both = [derivatives(feasible.sections, row)[:2] for row in random_lengths(feasible, 100)]
    scaled = np.array([np.concatenate((tip, 0.1 * spin)) for tip, spin in both])
    singular = np.linalg.svd(scaled, compute_uv=False)
    assert np.max(singular[:, 5] / singular[:, 0]) < 1e-14
    assert np.min(singular[:, 4] / singular[:, 0]) > 0.01


@settings(max_examples=100, deadline=None)
@given(
    q=st.one_of(st.floats(1e-20, 20.0), st.floats(0.499, 0.501), st.floats(1e-9, 1e-3)),
)
def test_coefficients_to_the_last_digits(q):
    """Against the series with 40 terms in exact order, on both sides of the switch."""
    c = arc.coefficients(np.array(q))
    terms = range(40)
    A = math.fsum((-q) ** k / math.factorial(2 * k + 1) for k in terms)
    B = math.fsum((-q) ** k / math.factorial(2 * k + 2) for k in terms)
    C = math.fsum((-q) ** k / math.factorial(2 * k + 3) for k in terms)
    A1 = math.fsum(-2.0 * (k + 1) * (-q) ** k / math.factorial(2 * k + 3) for k in terms)
    B1 = math.fsum(-2.0 * (k + 1) * (-q) ** k / math.factorial(2 * k + 4) for k in terms)
    np.testing.assert_allclose(c, (A, B, C, A1, B1), rtol=2e-14, atol=2e-14)


@pytest.mark.parametrize("name", ROBOTS)
def test_backbone_runs_at_equal_steps_from_base_to_tip(name):
    feasible = ROBOTS[name]()
    lengths = random_lengths(feasible, 1)[0]
    curve = backbone(feasible.sections, lengths, 2001)
    np.testing.assert_allclose(curve[0], 0.0, atol=1e-15)
    np.testing.assert_allclose(curve[-1], placed(feasible.sections, lengths)[0], atol=1e-14)
    steps = np.linalg.norm(np.diff(curve, axis=0), axis=-1)
    whole = lengths.sum() / 3 + sum(feasible.sections.rigid_m)
    np.testing.assert_allclose(steps, whole / 2000, rtol=1e-4)
