"""World and base frame: the documented matrix, its inverse, every field of a target."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from contid.kinematics.frames import BaseFrame
from contid.robot_file.base import BasePose
from contid.targets import Target

angles = st.floats(-360.0, 360.0) | st.sampled_from([-90.0, 0.0, 90.0, 180.0, 270.0])
places = st.floats(-500.0, 500.0)
bases = st.builds(
    BasePose,
    x_mm=places, y_mm=places, z_mm=places,
    roll_deg=angles, pitch_deg=angles, yaw_deg=angles,
    mirror_x=st.booleans(),
)  # fmt: skip
vectors = st.tuples(*[st.floats(-2.0, 2.0)] * 3)


def matrix_of(base: BasePose) -> np.ndarray:
    turned = Rotation.from_euler(
        "ZYX", [base.yaw_deg, base.pitch_deg, base.roll_deg], degrees=True
    ).as_matrix()
    return np.asarray(turned @ np.diag([-1.0 if base.mirror_x else 1.0, 1.0, 1.0]))


@given(bases, vectors)
def test_base_to_world_is_rotation_plus_origin(base: BasePose, vector: tuple[float, float, float]) -> None:
    frame, turned = BaseFrame.of(base), matrix_of(base) @ vector
    place_m = np.array([base.x_mm, base.y_mm, base.z_mm]) / 1e3
    assert frame.vector_in_world(vector) == pytest.approx(turned, abs=1e-12)
    assert frame.point_in_world(vector) == pytest.approx(turned + place_m, abs=1e-12)


@given(bases, vectors)
def test_world_and_base_transforms_are_inverse(base: BasePose, vector: tuple[float, float, float]) -> None:
    frame = BaseFrame.of(base)
    assert frame.vector_in_base(frame.vector_in_world(vector)) == pytest.approx(vector, abs=1e-12)
    assert frame.point_in_base(frame.point_in_world(vector)) == pytest.approx(vector, abs=1e-12)


def test_points_of_a_target_shift_and_directions_and_forces_only_turn() -> None:
    frame = BaseFrame.of(
        BasePose(x_mm=100, y_mm=-20, z_mm=5, roll_deg=30, pitch_deg=-50, yaw_deg=70, mirror_x=True)
    )
    points = {"tip_m": (0.1, 0.2, 0.3), "mid_m": (-0.1, 0.05, 0.2), "measured_tip_m": (0.12, 0.19, 0.31)}
    turning = {
        "direction": (0.6, 0.0, 0.8),
        "load_n": (0.5, -1.0, 2.0),
        "measured_direction": (0.0, 0.8, 0.6),
    }
    found = frame.target_in_base(Target(**points, **turning, extra={"wrist": 1.5}))
    for name, point in points.items():
        assert getattr(found, name) == frame.point_in_base(point)
    for name, vector in turning.items():
        assert getattr(found, name) == frame.vector_in_base(vector)
    assert found.extra == {"wrist": 1.5}
    own = Target(actuation=(0.1, 0.2))
    assert frame.target_in_base(own) == own
