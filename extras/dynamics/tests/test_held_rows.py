"""Rows of bends that are led back to their limits are within the cones, however far away they were."""

from __future__ import annotations

import numpy as np
import pytest

from contid.kinematics.model import build_model
from contid.robot_file.load import load_named
from contid_dynamics.coordinates import Bends, coordinates_of, held


def bends() -> Bends:
    loaded = load_named("tendon3")
    (robot,) = loaded.driven.values()
    found = coordinates_of(robot, build_model(robot), 1.0 / loaded.file.rate_hz)
    assert isinstance(found, Bends)
    return found


@pytest.mark.parametrize("size", [0.5, 1.0, 2.4])
def test_rows_beyond_a_cone_are_led_into_it(size: float) -> None:
    coordinates = bends()
    feasible = coordinates.model.feasible
    cones = np.array(feasible.sections.backbone_m) * np.array(feasible.bend_max_rad)
    rng, scale = np.random.default_rng(1), np.repeat(cones, 2)
    acted = 0
    for _ in range(60):
        path = 0.3 * scale * rng.normal(size=(1, len(scale)))
        found = held(coordinates, path, size * scale * rng.normal(size=(1, len(scale))))
        acted += found.ticks
        shares = np.hypot(*found.rows[0].reshape(-1, 2).T) / cones
        assert shares.max() < 1.0 + 1e-6
        room = feasible.offsets - feasible.normals @ found.rows[0]
        assert room.min() > -1e-9 * np.abs(feasible.offsets).max()
    assert acted > 10


def test_the_row_in_the_cones_that_is_nearest_for_the_tip_is_found() -> None:
    """Beside a search over the edge of the cone of the one section that is exceeded."""
    coordinates = bends()
    feasible = coordinates.model.feasible
    cones = np.array(feasible.sections.backbone_m) * np.array(feasible.bend_max_rad)
    wished = np.zeros(2 * len(cones))
    wished[:2] = 1.3 * cones[0] * np.array([0.6, 0.8])
    path = 0.5 * wished[None, :]
    slope = coordinates.tip_slope(path[0])

    def cost(row: np.ndarray) -> float:
        change = row - wished
        still = 0.05 * float(np.linalg.norm(slope, 2))
        return float(np.sum((slope @ change) ** 2) + still**2 * np.sum(change**2))

    found = held(coordinates, path, wished[None, :].copy()).rows[0]
    rng = np.random.default_rng(2)
    for _ in range(20_000):
        other = found + 0.02 * np.repeat(cones, 2) * rng.normal(size=len(found)) * rng.random()
        inside = (np.hypot(*other.reshape(-1, 2).T) <= cones).all()
        if inside and (feasible.normals @ other <= feasible.offsets).all():
            assert cost(other) >= cost(found) * (1.0 - 1e-6)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_rows_that_are_no_numbers_are_refused(value: float) -> None:
    coordinates = bends()
    rows = np.zeros((3, len(coordinates.model.feasible.sections.backbone_m) * 2))
    rows[1, 0] = value
    with pytest.raises(ValueError, match="finite"):
        held(coordinates, rows[:1], rows)
