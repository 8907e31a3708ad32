"""The two-rack finger against the reference's golden numbers, its inverse, limits and derivatives."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid.kinematics.rack.finger import RackFingerModel
from contid.robot_file.rack_finger import RackFinger
from contid.targets import Target
from studies.morita_levenberg_marquardt import solve

MM = 1e-3


def finger(
    h_mm: float = 22.0, *, corrected: bool = False, length_mm: float = 100.0, spacing_mm: float = 13.0
) -> RackFingerModel:
    return RackFingerModel(
        RackFinger.model_validate(
            {
                "model": "rack_finger",
                "geometry": {
                    "rack_spacing_mm": spacing_mm,
                    "tip_length_mm": h_mm,
                    "link": {"length_mm": 6, "width_mm": 13, "gap_mm": 5},
                },
                "limits": {"length_mm": (0, length_mm)},
                "rates": {"velocity_mm_s": 100, "acceleration_mm_s2": 1000, "jerk_mm_s3": 10000},
                "correction": {"a_per_mm": 0.0013, "b": -0.2774, "arc_length_mm": (0, 213.4)}
                if corrected
                else None,
            }
        )
    )


def tip_target(x_mm: float, y_mm: float) -> Target:
    return Target(tip_m=(x_mm * MM, y_mm * MM, 0.0))


def mm(values: tuple[float, ...]) -> list[float]:
    return [v * 1e3 for v in values]


def tip_of(s: np.ndarray, k: np.ndarray, h: float) -> np.ndarray:
    """x and y of the tip of an arc with a straight piece, by radius and angle."""
    k = np.where(k == 0.0, 1e-12, k)
    radius, theta = 1.0 / k, s * k
    return np.array(
        [radius * (1.0 - np.cos(theta)) + h * np.sin(theta), radius * np.sin(theta) + h * np.cos(theta)]
    )


FORWARD = [  # reference A6: L1, L2, h -> x, y, theta
    (60, 60, 0, 0, 60, 0),
    (60, 80, 0, 44.029023489207, 45.476216070653, 1.538461538462),
    (60, 80, 20, 64.018569014769, 46.122799152320, 1.538461538462),
    (80, 60, 20, -64.018569014769, 46.122799152320, -1.538461538462),
    (99.999999, 100, 0, 3.846154e-6, 99.999999500000, 7.6923077e-8),
    (5, 15, 2.4, 5.329601409548, 10.766846588653, 0.769230769231),
    (30, 90, 22, -7.637492875713, -15.069634627451, 4.615384615385),
]
INVERSE = [  # reference A6: x, y, h -> L1, L2, k, S, theta
    (50, 70, 0, 83.7336806077, 99.8601672432, 0.0135135135135, 91.7969239255, 1.24049897197),
    (50, 70, 22, 62.3870947236, 75.3304753716, 0.0144592249855, 68.8587850476, 0.995644665234),
    (70, 70, 22, 78.1063200321, 95.0172767842, 0.0150279089738, 86.5617984082, 1.30084282709),
    (30, 70, 22, 51.7582536991, 59.9538358926, 0.0112866817156, 55.8560447958, 0.630429399501),
    (50, 90, 22, 79.4916734982, 90.4085523855, 0.00988533017003, 84.9501129418, 0.839759914411),
    (50, 50, 22, 46.9322861841, 62.7139654493, 0.022143489814, 54.8231258167, 1.21397532809),
    (50, 20, 22, 30.8038612532, 53.4794103071, 0.0413907284768, 42.1416357802, 1.74427300415),
    (50, 100, 22, 88.4176780023, 98.5305568869, 0.00832223701731, 93.4741174446, 0.777913760358),
    (-40, 60, 0, 84.0843723073, 68.7963046151, -0.0153846153846, 76.4403384612, -1.1760052071),
    (0, 90, 22, 68, 68, 0, 68, 0),
]
CORRECTED = [  # reference A6: x, y -> k_cmd, L1, L2 (h = 22)
    (70, 70, 0.017994686926, 76.4370574042, 96.6865394121),
    (30, 70, 0.014193283721, 50.7029703022, 61.0091192894),
    (50, 90, 0.011866642371, 78.3976409789, 91.5025849047),
    (50, 50, 0.027893090860, 44.8834140240, 64.7628376093),
    (50, 20, 0.053243598712, 27.5571155408, 56.7261560196),
    (50, 100, 0.009859111236, 87.4839012543, 99.4643336349),
]


@pytest.mark.parametrize(("left", "right", "h", "x", "y", "theta"), FORWARD)
def test_forward_reproduces_the_reference(left, right, h, x, y, theta) -> None:
    model = finger(h)
    racks = (left * MM, right * MM)
    assert mm(model.forward(racks).tip_m[:2]) == pytest.approx([x, y], abs=1e-9)
    assert model.arc(racks)[1] == pytest.approx(theta, abs=1e-12)


@pytest.mark.parametrize(("x", "y", "h", "left", "right", "k", "s", "theta"), INVERSE)
def test_inverse_reproduces_the_reference(x, y, h, left, right, k, s, theta) -> None:
    model = finger(h)
    solution = model.inverse(tip_target(x, y), (0.05, 0.05))
    assert solution.converged
    assert not solution.limited_by
    # The print has ten decimals, so half a unit of the last one is the finest it can be held to.
    assert mm(solution.actuation) == pytest.approx([left, right], abs=1e-9)
    arc = model.solve_arc(x * MM, y * MM)
    assert arc is not None
    assert arc[0] * 1e3 == pytest.approx(s, abs=1e-9)
    assert arc[1] / 1e3 == pytest.approx(k, abs=1e-12)
    assert arc[0] * arc[1] == pytest.approx(theta, abs=1e-10)


@pytest.mark.parametrize(("x", "y", "k_cmd", "left", "right"), CORRECTED)
def test_corrected_commands_reproduce_the_reference(x, y, k_cmd, left, right) -> None:
    model = finger(22, corrected=True)
    racks = mm(model.inverse(tip_target(x, y), (0.05, 0.05)).actuation)
    assert racks == pytest.approx([left, right], abs=1e-9)
    assert (racks[1] - racks[0]) / 13 / (sum(racks) / 2) == pytest.approx(k_cmd, abs=1e-11)


@pytest.mark.parametrize("count", [pytest.param(20_000, marks=pytest.mark.campaign), 4_000])
def test_random_poses_round_trip(count: int) -> None:
    """FK(IK(FK)) over the whole feasible set, both bending signs, both branches, to 1e-9 mm."""
    rng = np.random.default_rng(2)
    worst = 0.0
    for h in (0.0, 2.4, 11.35, 22.0, 40.0):
        model = finger(h)
        left, right = rng.uniform(0.0, 0.1, (2, count))
        for racks in zip(left.tolist(), right.tolist(), strict=True):
            if model.kernel.clamp(*racks) != racks:
                continue
            arc_length, theta = model.arc(racks)
            # G = 0 is the point (0, -h), where every curl ends: the reference restricts to G > 1 mm too.
            g = 0.5 * arc_length * math.sin(theta / 2) / (theta / 2) + h * MM * math.cos(theta / 2)
            if abs(g) < 1e-3:
                continue
            tip = model.forward(racks).tip_m
            again = model.inverse(Target(tip_m=tip), racks)
            assert again.converged, (racks, again)
            worst = max(worst, *(abs(a - r) for a, r in zip(again.actuation, racks, strict=True)))
    assert worst < 1e-12, f"{worst} m"


def test_both_branches_occur_in_the_round_trip() -> None:
    """d < 0, a tip curled back inside radius h, needs the second branch."""
    model = finger(22, length_mm=120)
    racks = (0.030, 0.090)
    tip = model.forward(racks).tip_m
    assert tip[0] ** 2 + tip[1] ** 2 < 0.022**2
    arc = model.solve_arc(tip[0], tip[1])
    assert arc is not None
    assert arc == pytest.approx((0.060, 0.060 / 0.013 / 0.060), rel=1e-12)


@pytest.mark.parametrize(
    ("x", "y", "h", "limits", "message"),
    [
        (10, -5, 0, {"curvature"}, "curvature 0.16 /mm is above 0.0761924 /mm"),
        (10, 5, 22, {"right.min", "left.max"}, "left rack would be"),
        (5, -15, 22, {"left.max"}, "left rack would be"),
        (0, 130, 22, {"left.max", "right.max"}, "right rack would be 8 mm too long"),
        (0, -60, 22, {"no_arc"}, "no arc of this finger ends there"),
        (0, 22.5, 22, {"arc_length.min"}, "arc length 0.5 mm is below 1 mm"),
    ],
)
def test_unreachable_targets_report_limit_and_excess(x, y, h, limits, message) -> None:
    model = finger(h)
    solution = model.inverse(tip_target(x, y), (0.05, 0.05))
    assert not solution.converged
    assert limits & set(solution.limited_by)
    assert message in solution.note
    assert model.kernel.clamp(*solution.actuation) == pytest.approx(solution.actuation, abs=1e-15)


@given(x=st.floats(-150, 150), y=st.floats(-120, 150), corrected=st.booleans())
def test_the_answer_is_always_inside_the_limits_and_the_nearest(x, y, corrected) -> None:
    model = finger(22, corrected=corrected)
    solution = model.inverse(tip_target(x, y), (0.05, 0.05))
    left, right = solution.actuation
    assert 0 <= left <= 0.1
    assert 0 <= right <= 0.1
    arc_length, theta = model.arc(solution.actuation)
    assert abs(theta / arc_length) <= 76.1923959021358 * (1 + 1e-9)
    reached = model.forward(solution.actuation).tip_m
    assert math.hypot(reached[0] - x * MM, reached[1] - y * MM) == pytest.approx(
        solution.residual_m, abs=1e-12
    )
    if solution.converged:
        return
    rng = np.random.default_rng(0)
    for _ in range(50):
        racks = model.kernel.clamp(*rng.uniform(0, 0.1, 2).tolist())
        other = model.forward(racks).tip_m
        assert math.hypot(other[0] - x * MM, other[1] - y * MM) >= solution.residual_m - 1e-7


@pytest.mark.parametrize(("corrected", "x", "y"), [(False, 5.6494, -14.1449), (True, 4.4073, -26.3603)])
def test_the_global_minimum_along_the_boundary_is_found(corrected, x, y) -> None:
    """The nearest sample of the boundary lies in the valley of a point half a millimetre farther away."""
    model = finger(corrected=corrected)
    found = model.inverse(tip_target(x, y), (0.05, 0.05))
    away = math.inf
    for left, right in itertools.product(np.linspace(0.0, 0.1, 201).tolist(), repeat=2):
        arc_length_m = 0.5 * (left + right)
        if arc_length_m >= 1e-3:
            bend = (right - left) / (model.rack_spacing_m * arc_length_m)
            if abs(bend) * model.curvature_gain(arc_length_m) <= model.envelope.curvature_max_per_m:
                away = min(away, math.dist(model.forward((left, right)).tip_m, (x * MM, y * MM, 0.0)))
    assert found.residual_m <= away


@pytest.mark.parametrize(
    ("h", "length", "spacing"), [(22.0, 160.0, 0.12), (0.0, 90.0, 0.3), (40.0, 200.0, 0.1)]
)
def test_of_a_slender_finger_too(h, length, spacing) -> None:
    """Its tip turns by a whole turn where its racks begin to bind, within a hundredth of an even interval."""
    model = finger(h, length_mm=length, spacing_mm=spacing)
    ramp = np.linspace(0.0, 8.0 * spacing, 8001)  # of the arc length before the longest, where racks bind
    s = np.concatenate([np.linspace(1e-3 * length, length, 8001), length - ramp])
    bound = np.minimum(model.envelope.curvature_max_per_m * MM, 2.0 * np.pi / s)
    bend = np.minimum(bound, 2.0 * (length / s - 1.0) / spacing)
    samples = [(s, bend), (s, -bend), (s, 0.5 * bend)]
    tips = np.array([tip_of(*curve, h) for curve in samples])
    rng = np.random.default_rng(16)
    for goal in rng.uniform(-1.3, 1.3, (25, 2)) * (length + h):
        nearest = np.hypot(tips[:, 0] - goal[0], tips[:, 1] - goal[1]).min()
        assert model.inverse(tip_target(*goal), (0.0, 0.0)).residual_m / MM <= nearest + 1e-9


@given(left=st.floats(0.005, 0.1), bend=st.floats(-0.07, 0.07), h=st.floats(0, 40), corrected=st.booleans())
def test_the_jacobian_is_the_derivative_of_forward(left, bend, h, corrected) -> None:
    model = finger(h, corrected=corrected)
    racks = (left, left + bend)
    step = 1e-7
    for axis in range(2):
        forward = [list(racks), list(racks)]
        forward[0][axis] += step
        forward[1][axis] -= step
        ahead, behind = (np.array(model.forward(tuple(r)).tip_m) for r in forward)
        assert model.jacobian(racks)[:, axis] == pytest.approx((ahead - behind) / (2 * step), abs=2e-6)


def test_limits_of_equation_9_with_the_erratum() -> None:
    model = finger()
    assert model.envelope.curvature_max_per_m == pytest.approx(76.1923959021358, rel=1e-13)


def test_shape_starts_at_the_base_ends_at_the_tip_and_has_the_length() -> None:
    model = finger(22, corrected=True)
    racks = (0.05, 0.07)
    shape = model.shape(racks, 200)
    assert shape[0] == pytest.approx([0, 0, 0])
    assert shape[-1] == pytest.approx(model.forward(racks).tip_m, abs=1e-15)
    length = np.linalg.norm(np.diff(shape, axis=0), axis=1).sum()
    assert length == pytest.approx(0.06 + 0.022, rel=1e-5)


def test_the_curvature_correction_is_clamped_to_its_identified_range() -> None:
    model = finger(22, corrected=True)
    assert model.curvature_gain(0.3) == model.curvature_gain(0.2134)
    assert model.curvature_gain(0.05) == pytest.approx(0.7876, abs=1e-12)


def test_actuation_targets_are_clamped_into_the_limits() -> None:
    model = finger()
    inside = model.inverse(Target(actuation=(0.05, 0.06)), (0.05, 0.05))
    assert inside.actuation == (0.05, 0.06)
    assert inside.converged
    outside = model.inverse(Target(actuation=(0.0, 0.1)), (0.05, 0.05))
    assert not outside.converged
    assert "curvature" in outside.limited_by


def test_levenberg_marquardt_agrees_with_the_closed_form_where_it_converges() -> None:
    """Algorithm 1, warm-started along the paper's circle; and it does fail from a cold start."""
    model = finger(22)
    arc = model.solve_arc(0.070, 0.070)
    assert arc is not None
    start = (arc[1] / 1e3, arc[0] * 1e3)
    iterations = []
    for i in range(150):
        phi = 2 * math.pi * i / 360
        x, y = 50 + 20 * math.cos(phi), 70 + 20 * math.sin(phi)
        found = solve(x, y, 22, start=start)
        assert found.converged
        exact = model.solve_arc(x * MM, y * MM)
        assert exact is not None
        assert found.arc_length_mm == pytest.approx(exact[0] * 1e3, abs=1e-5)
        assert found.curvature_per_mm == pytest.approx(exact[1] / 1e3, abs=1e-7)
        start = (found.curvature_per_mm, found.arc_length_mm)
        iterations.append(found.iterations)
    assert 2.5 < np.mean(iterations) < 4.5  # reference A5: 3.42
    rng = np.random.default_rng(0)
    wrong = 0
    for _ in range(30):
        racks = model.kernel.clamp(*rng.uniform(0.02, 0.1, 2).tolist())
        tip = model.forward(racks).tip_m
        found = solve(tip[0] * 1e3, tip[1] * 1e3, 22, start=(0.01, 50))
        exact = model.solve_arc(tip[0], tip[1])
        assert exact is not None
        same = abs(found.arc_length_mm - exact[0] * 1e3) < 1e-3
        wrong += not (found.converged and same)
    assert wrong > 0, "a cold start that always converges would make the closed form unnecessary"


@pytest.mark.parametrize("far", [1e7, 1e155, 1e308])
@pytest.mark.parametrize("way", [(1, 0), (0, 1), (-1, 1), (1, -1)])
def test_targets_whose_squares_overflow_are_out_of_reach(far, way):
    """The nearest point is that of a target 1 km away in the same direction."""
    model = finger()
    x, y = (sign * far if sign else 0.0 for sign in way)
    solution = model.inverse(Target(tip_m=(x, y, 0.0)), (0.08, 0.08))
    assert not solution.converged
    assert solution.limited_by
    assert solution.residual_m == pytest.approx(math.hypot(x, y), rel=1e-6)
    near = model.inverse(Target(tip_m=(1e3 * way[0], 1e3 * way[1], 0.0)), (0.08, 0.08))
    np.testing.assert_allclose(solution.actuation, near.actuation, rtol=0.0, atol=2e-5)
