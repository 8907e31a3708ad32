"""mu from tensions at both ends: elements of a tendon that stick or slide over a bend, written apart."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contid.errors import BadInputError
from contid.kinematics.array import Array
from contid_fit.calibrate.tendon.ends import capstan_from_ends
from contid_fit.calibrate.tendon.recording import read_recording

NODES = 10
#: Of an element of the tendon and of the body [N/m]; pretension [N]; bend per way of the body [rad/m].
ELEMENT, BODY, PRE = 60_000.0, 600.0, 4.0
PER_M = 60.0


def settle(place: list[float], mu: float) -> None:
    """Every node slides until friction holds its two tensions; the last one is free."""
    for _ in range(600):
        moved = 0.0
        grip = math.exp(mu * PER_M * max(place[-1], 0.0) / (len(place) - 2))
        for i in range(1, len(place) - 1):
            before, after = place[i - 1], place[i + 1]
            near, far = PRE + ELEMENT * (before - place[i]), PRE + ELEMENT * (place[i] - after)
            ratio = min(max(near / far, 1.0 / grip), grip)
            if ratio == near / far:
                continue
            # near = ratio * far, solved for the place of the node
            there = (PRE * (1.0 - ratio) / ELEMENT + before + ratio * after) / (1.0 + ratio)
            moved, place[i] = max(moved, abs(there - place[i])), there
        body = ELEMENT * place[-2] / (ELEMENT + BODY)
        moved, place[-1] = max(moved, abs(body - place[-1])), body
        if moved < 1e-9:
            return


def recorded(mu: float, gain: float, noise: float) -> tuple[Array, Array, Array]:
    """Angles, pulls and both tensions of swings; the far cell reads ``gain`` times too much."""
    rng = np.random.default_rng(5)
    place, rows = [0.0] * (NODES + 2), []
    for goal in (0.016, 0.006, 0.018, 0.003, 0.012, 0.002):
        for pull in np.linspace(place[0], goal, 25)[1:]:
            place[0] = float(pull)
            settle(place, mu)
            near, far = PRE + ELEMENT * (place[0] - place[1]), PRE + BODY * place[-1]
            rows.append((PER_M * place[-1], pull, near, far * gain))
    table = np.array(rows)
    ends = table[:, None, 2:] * np.exp(noise * rng.normal(size=(len(table), 1, 2)))
    return table[:, :1], table[:, 1:2], ends


@pytest.mark.parametrize("mu", [0.08, 0.2])
def test_mu_is_that_of_the_elements_whatever_the_cells_are_calibrated_to(mu: float) -> None:
    turned, pull, ends = recorded(mu, gain=1.1, noise=0.01)
    found = capstan_from_ends(turned, pull, ends, np.zeros(len(pull)))
    assert found is not None
    assert found.low <= mu <= found.high
    assert found.value == pytest.approx(mu, rel=0.07)
    assert found.high - found.low < 0.3 * mu


def test_a_recording_has_both_tensions_of_the_tendons_with_cells() -> None:
    head = "timestamp,pattern_label,servo_1_mm,servo_2_mm,servo_3_mm,tip_x,tip_y,tip_z"
    rows = [f"{head},servo_2_far_n,servo_2_near_n", "0,a,1,2,3,0,0,9,4.5,5.5", "1,a,1,2,3,0,0,9,4.6,5.6"]
    data = read_recording(rows, "cells.csv")
    ends_n = data.in_order((1, 0, 2)).rows(1, 2).followed_by(data.in_order((1, 0, 2))).ends_n
    assert ends_n is not None
    assert ends_n[:, 0].tolist() == [[5.6, 4.6], [5.5, 4.5], [5.6, 4.6]]
    assert np.isnan(ends_n[:, 1:]).all()
    with pytest.raises(BadInputError, match="servo_2_near_n"):
        read_recording([rows[0].removesuffix(",servo_2_near_n"), rows[1].removesuffix(",5.5")], "one.csv")


def test_pulls_in_one_direction_and_tendons_without_cells_give_none() -> None:
    turned, pull, ends = recorded(0.1, gain=1.0, noise=0.0)
    runs = np.zeros(len(pull))
    assert capstan_from_ends(turned, pull, np.full_like(ends, np.nan), runs) is None
    assert capstan_from_ends(turned[:24], pull[:24], ends[:24], runs[:24]) is None
