"""The papers' own solvers: golden values, drift and its causes, targets out of reach."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest

from studies import hughes, singh
from studies.arc_chains import forward
from studies.distal_learning import InverseNetwork, NetworkFileError, Recipe, train
from studies.network import Network
from tests.kinematics.section_robots import GOLDEN, one_segment

SECTIONS = singh.cbha_sections()
PATH = singh.golden_trajectory()


def test_the_golden_trajectory():
    np.testing.assert_allclose(PATH.lengths_m[0] * 1e3, GOLDEN["traj"]["l0"], atol=1e-10)
    np.testing.assert_allclose(PATH.lengths_m[99] * 1e3, GOLDEN["traj"]["l99"], atol=1e-10)
    for k, key in ((0, "P0"), (1, "P1"), (50, "P50"), (99, "P99")):
        np.testing.assert_allclose(PATH.tips_m[k] * 1e3, GOLDEN["traj"][key], atol=1e-10)
    np.testing.assert_allclose(PATH.tips_m.sum(axis=0) * 1e3, GOLDEN["traj"]["checksum_sum_P"], atol=1e-8)


def test_newton_raphson():
    lengths = PATH.lengths_m[0]
    for k, target in enumerate(PATH.tips_m[1:], start=1):
        lengths, updates = singh.newton_raphson(SECTIONS, target, lengths, 1e-15, most=8)
        if k == 1:
            np.testing.assert_allclose(lengths * 1e3, GOLDEN["nr"]["l1"], atol=1e-8)
    np.testing.assert_allclose(lengths * 1e3, GOLDEN["nr"]["l99"], atol=1e-8)
    middle = 0.5 * (np.array(singh.LOWER_M) + np.array(singh.UPPER_M))
    found, _ = singh.newton_raphson(SECTIONS, PATH.tips_m[25], middle, 1e-15, most=20)
    np.testing.assert_allclose(found * 1e3, GOLDEN["nr"]["from_mid_to_T25"], atol=1e-8)
    _, updates = singh.newton_raphson(SECTIONS, PATH.tips_m[1], PATH.lengths_m[0])
    assert updates <= 3  # as the paper reports for 1e-3 mm
    at_once = singh.newton_raphson_path(SECTIONS, PATH.tips_m, PATH.lengths_m[0])
    np.testing.assert_allclose(forward(SECTIONS, at_once).tip, PATH.tips_m, atol=1e-6)


@pytest.mark.parametrize(
    ("golden", "solver"), [("dls_paper", "dls_as_printed"), ("dls_fk", "dls_with_feedback")]
)
def test_damped_least_squares(golden, solver):
    lengths = getattr(singh, solver)(SECTIONS, PATH.tips_m, PATH.lengths_m[0])
    np.testing.assert_allclose(lengths[-1] * 1e3, GOLDEN[golden]["l99"], atol=1e-9)
    error = (forward(SECTIONS, lengths).tip - PATH.tips_m) * 1e3
    np.testing.assert_allclose(np.abs(error).max(axis=0), GOLDEN[golden]["max_abs_err_xyz"], atol=1e-9)
    np.testing.assert_allclose(error[-1], GOLDEN[golden]["end_err"], atol=1e-9)


@pytest.mark.campaign
def test_feedback_cures_the_drift_and_a_smaller_damping_does_not():
    def worst(lengths):
        return np.max(np.linalg.norm(forward(SECTIONS, lengths).tip - PATH.tips_m, axis=-1)) * 1e3

    start = PATH.lengths_m[0]
    printed = {k: worst(singh.dls_as_printed(SECTIONS, PATH.tips_m, start, k)) for k in (0.5, 0.1, 0.01)}
    assert printed[0.5] == pytest.approx(6.41, abs=5e-3)
    assert printed[0.1] == pytest.approx(5.86, abs=5e-3)
    assert printed[0.01] == pytest.approx(5.83, abs=5e-3)
    assert worst(singh.dls_with_feedback(SECTIONS, PATH.tips_m, start, 0.5)) == pytest.approx(0.74, abs=5e-3)
    assert worst(singh.dls_with_feedback(SECTIONS, PATH.tips_m, start, 0.5, 5)) == pytest.approx(
        2.8e-3, abs=5e-5
    )
    assert worst(singh.dls_with_feedback(SECTIONS, PATH.tips_m, start, 0.5, 20)) < 1e-10


@pytest.mark.campaign
def test_many_paths_at_once_are_the_same_as_one_by_one():
    rng = np.random.default_rng(0)
    paths = [singh.random_trajectory(rng) for _ in range(3)]
    tips = np.stack([path.tips_m for path in paths])
    starts = np.stack([path.lengths_m[0] for path in paths])
    for solver in (singh.dls_as_printed, singh.dls_with_feedback, singh.newton_raphson_path):
        together = solver(SECTIONS, tips, starts)
        for k, path in enumerate(paths):
            np.testing.assert_allclose(
                together[k], solver(SECTIONS, path.tips_m, path.lengths_m[0]), atol=1e-13
            )


@pytest.mark.parametrize("phi_deg", [0, 120, 180, 300])
def test_the_printed_m_is_singular_where_the_paper_uses_it(phi_deg):
    assert abs(np.linalg.det(hughes.printed_m(math.radians(phi_deg)))) < 1e-12


def test_the_printed_m_has_one_wrong_sign():
    phi = 0.4
    corrected = hughes.printed_m(phi)
    corrected[1, 2] *= -1.0
    assert np.linalg.det(corrected) == pytest.approx(0.3849001794597505)
    np.testing.assert_allclose(corrected @ (1, 1, 1), (0, 0, 1), atol=1e-15)
    assert abs((hughes.printed_m(phi) @ (1, 1, 1))[1]) > 0.1  # equal racks would bend


@pytest.mark.parametrize("variant", hughes.Variant)
def test_hughes_dynamics_inside_the_workspace(variant):
    rest = hughes.settle(one_segment(), np.array((0.12, 0.12, 0.3)), np.array((0.29, 0.31, 0.3)), variant)
    assert rest.settled
    assert rest.error_m < 1e-8
    expected = (385.8641487721, 369.7094650420, 325.5740483114)
    np.testing.assert_allclose(rest.lengths_m * 1e3, expected, atol=1e-5)


def test_hughes_dynamics_outside_the_workspace():
    """The worked example: only the full form ends at the optimum of Eq. 4."""
    feasible, target, start = one_segment(), np.array((0.3, 0.0, 0.7)), np.array((0.29, 0.31, 0.3))
    full = hughes.settle(feasible, target, start, hughes.Variant.FULL)
    assert full.settled
    assert full.error_m * 1e3 == pytest.approx(153.276456009, abs=1e-6)
    corrected = hughes.settle(feasible, target, start, hughes.Variant.CORRECTED)
    np.testing.assert_allclose(corrected.lengths_m * 1e3, 650.0, atol=1e-4)
    assert corrected.error_m * 1e3 == pytest.approx(304.138, abs=1e-3)
    printed = hughes.settle(feasible, target, start, hughes.Variant.PRINTED)
    assert not printed.settled
    assert np.max(printed.lengths_m) > 0.690  # 40 mm outside the limits
    assert printed.error_m * 1e3 == pytest.approx(113.3, abs=0.3)


@pytest.mark.parametrize("bounded", [False, True])
def test_the_gradient_of_a_network(bounded):
    rng = np.random.default_rng(0)
    network = Network.random(3, 5, 2, bounded, rng)
    x, seed = rng.normal(size=(4, 3)), rng.normal(size=(4, 2))
    y, back = network.with_gradient(x)
    np.testing.assert_array_equal(y, network(x))
    by_parameters, by_input = back(seed)

    def loss(parameters, inputs):
        return float((network.at(parameters)(inputs) * seed).sum())

    for k in range(len(network.parameters)):
        step = np.zeros(len(network.parameters))
        step[k] = 1e-6
        slope = (loss(network.parameters + step, x) - loss(network.parameters - step, x)) / 2e-6
        assert by_parameters[k] == pytest.approx(slope, abs=1e-8)
    for index in np.ndindex(x.shape):
        step = np.zeros_like(x)
        step[index] = 1e-6
        slope = (loss(network.parameters, x + step) - loss(network.parameters, x - step)) / 2e-6
        assert by_input[index] == pytest.approx(slope, abs=1e-8)


@pytest.mark.campaign
def test_a_small_network_is_trained_saved_and_loaded(tmp_path):
    reported = []
    recipe = Recipe(hidden=10, levels=3, noise_m=0.0, iterations=150)
    network = train(recipe, lambda what, iteration, error_mm: reported.append(what))
    assert set(reported) == {"forward network", "inverse network"}
    error = np.linalg.norm(forward(SECTIONS, network.lengths(PATH.tips_m)).tip - PATH.tips_m, axis=-1)
    assert error.mean() < 8e-3
    assert np.max(network.lengths(np.array((1.0, 1.0, 1.0)))) <= 0.150
    path = tmp_path / "net.npz"
    network.save(path)
    back = InverseNetwork.load(path)
    np.testing.assert_array_equal(back.lengths(PATH.tips_m), network.lengths(PATH.tips_m))
    assert back.trained_mm == network.trained_mm


def test_a_file_that_is_no_network_is_refused(tmp_path):
    wrong = tmp_path / "wrong.npz"
    np.savez(wrong, parameters=np.zeros(3))
    with pytest.raises(NetworkFileError, match="hidden, centre_m"):
        InverseNetwork.load(wrong)
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(NetworkFileError, match=r"text\.npz"):
        InverseNetwork.load(tmp_path / "text.npz")


def test_a_damaged_network_is_refused(tmp_path):
    whole, damaged = tmp_path / "whole.npz", tmp_path / "damaged.npz"
    train(Recipe(hidden=2, levels=2, iterations=1)).save(whole)
    with np.load(whole) as stored:
        keys = dict(stored)
    array = io.BytesIO()
    np.save(array, keys["centre_m"])
    short = io.BytesIO()
    np.savez(short, **{**keys, "parameters": keys["parameters"][:-1]})
    for data in (whole.read_bytes()[:-50], b"", array.getvalue(), short.getvalue()):
        damaged.write_bytes(data)
        with pytest.raises(NetworkFileError, match=r"damaged\.npz: no network saved by contid"):
            InverseNetwork.load(damaged)
