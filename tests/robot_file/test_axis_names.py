"""Names of axes in a robot file: none takes the key of another value in recordings."""

from __future__ import annotations

import pytest

from contid.control.engine.tick_layout import ROBOT
from contid.control.engine.wiring import record_layout
from contid.errors import BadInputError
from contid.robot_file.axis_names import axis_name_mistake
from contid.robot_file.load import configs_folder, parse_robot_file
from contid.session.format.channels import TICK_CHANNELS, fields

#: Keys of axes in a channel: their name with the unit; in ``sample`` the name has an object of its own.
UNITS = {"target": ("_m", "_pa", "_rad"), "solution": ("_m", "_pa", "_rad"), "command": ("_m", "_pa", "_rad"),
         "sample": ("",)}  # fmt: skip
TAKEN = sorted(
    {
        value.name.removesuffix(unit)
        for value in ROBOT.values
        for unit in UNITS.get(value.about.channel, ())
        if value.name.endswith(unit)
    }
)


def finger(axis: str) -> str:
    """The robot file of a finger with an extra axis."""
    text = (configs_folder() / "finger.yaml").read_text(encoding="utf-8")
    return text.replace("    rates:\n", f"    extra_mm: {{{axis}: [0, 50]}}\n    rates:\n", 1).replace(
        "    placeholder:", f"      {axis}: {{bus: servos, id: 7, mm_per_rev: 37.7}}\n    placeholder:", 1
    )


@pytest.mark.parametrize("axis", TAKEN)
def test_a_name_of_another_recorded_value_is_refused(axis: str) -> None:
    assert {"tip", "mid", "residual"} < {*TAKEN}
    with pytest.raises(BadInputError, match=rf"'{axis}' is another value of the robot in recordings"):
        parse_robot_file(finger(axis), "finger.yaml")


@pytest.mark.parametrize("axis", ["wrist", "load", "direction", "limits", "device"])
def test_values_of_a_record_have_a_key_each(axis: str) -> None:
    loaded = parse_robot_file(finger(axis), "finger.yaml")
    layout = record_layout(loaded, 200.0)
    units = {f"finger.{each}": "rad" for each in layout.robots[0].axes}
    for channel in TICK_CHANNELS:
        paths = [field.path for field in fields(layout, units, channel)]
        assert len({*paths}) == len(paths)


def test_an_extra_axis_is_not_called_as_one_of_the_model_in_recordings() -> None:
    text = (configs_folder() / "trirack.yaml").read_text(encoding="utf-8")
    text = text.replace("    rates:\n", "    extra_mm: {s1_l1: [0, 50]}\n    rates:\n", 1)
    with pytest.raises(BadInputError, match="'s1_l1' is an axis of the model"):
        parse_robot_file(text, "trirack.yaml")


def test_names_of_drives_are_checked_alike() -> None:
    assert axis_name_mistake("bend") == ""
    assert "coordinate of the tip" in axis_name_mistake("x")
    assert "allowed are letters" in axis_name_mistake("1st")
