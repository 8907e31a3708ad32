"""``contid move finger left_mm=58``: axes that are left out beside others stay."""

from __future__ import annotations

import pytest

from contid.remote.client.move_arguments import with_other_axes

AXES = {"left": {"min_mm": 0.0, "max_mm": 100.0}, "right": {"min_mm": 0.0, "max_mm": 100.0}}
ROBOT = {
    "unit": "mm",
    "axes": AXES,
    "velocity_mm_s": 1.0,
    "acceleration_mm_s2": 1.0,
    "jerk_mm_s3": 1.0,
    "columns": ["x_mm", "y_mm", "left_mm", "right_mm"],
    "stop": {"estop": "relax"},
}
AT = {"axes": {"left": {"command_mm": 60.0}, "right": {"command_mm": 61.0}}}


@pytest.mark.parametrize(
    ("robots", "target", "whole"),
    [
        (1, {"left_mm": 58.0}, {"left_mm": 58.0, "right_mm": 61.0}),
        (1, {"f0.right_mm": 58.0}, {"f0.right_mm": 58.0, "f0.left_mm": 60.0}),
        (2, {"f1.left_mm": 58.0}, {"f1.left_mm": 58.0, "f1.right_mm": 61.0}),
        (2, {"left_mm": 58.0}, {"left_mm": 58.0}),  # of which? The daemon asks.
        (1, {"x_mm": 1.0, "left_mm": 58.0}, {"x_mm": 1.0, "left_mm": 58.0}),  # two kinds: it refuses.
        (1, {"x_mm": 1.0, "y_mm": 2.0}, {"x_mm": 1.0, "y_mm": 2.0}),
        (1, {"nonsense_mm": 1.0}, {"nonsense_mm": 1.0}),
    ],
)
def test_axes_left_out_beside_others_stay(
    robots: int, target: dict[str, float], whole: dict[str, float]
) -> None:
    names = [f"f{k}" for k in range(robots)]
    describe = {"robots": dict.fromkeys(names, ROBOT)}
    assert with_other_axes(target, describe, {"robots": dict.fromkeys(names, AT)}) == whole


def test_a_command_that_is_unknown_is_left_out() -> None:
    status = {"robots": {"f0": {"axes": {"left": {"command_mm": None}, "right": {"command_mm": None}}}}}
    assert with_other_axes({"left_mm": 58.0}, {"robots": {"f0": ROBOT}}, status) == {"left_mm": 58.0}
