"""Mistakes in a mapping have their place; devices and commands that do not fit are named."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from contid.errors import BadInputError, ContidError
from contid_hands.teleop.gamepad.device import Capabilities
from contid_hands.teleop.gamepad.find import find_device
from contid_hands.teleop.gamepad.mapping import default_mapping, read_mapping
from tests.support.command import contid
from tests.support.pads import SPACENAVIGATOR, XBOX

pytestmark = pytest.mark.process

GOOD = "contid_gamepad: 1\ndead_man: BTN_TL\nestop: BTN_EAST\naxes:\n  - {input: ABS_X}\n"


@pytest.mark.parametrize(
    ("has", "columns", "scales"),
    [(XBOX, 3, [1.0, -1.0, -1.0]), (SPACENAVIGATOR, 3, [1.0, -1.0, -1.0])],
)
def test_shipped_mappings_fit_their_devices(has: Capabilities, columns: int, scales: list[float]) -> None:
    bound = read_mapping(default_mapping(has.kind), has)
    assert [each.scale for each in bound.tip if each] == scales
    assert len(bound.tip) == columns
    assert len(bound.axes) == 4


def test_kernels_that_give_a_3d_mouse_absolute_axes_need_no_other_file() -> None:
    stick = XBOX.absolute[0]._replace(minimum=-350, maximum=350, flat=0)
    has = replace(SPACENAVIGATOR, relative=frozenset(), absolute=dict.fromkeys(range(6), stick))
    assert has.kind == "spacemouse"
    assert [each.half for each in read_mapping(default_mapping(has.kind), has).inputs] == [350.0] * 7


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("BTN_TL", "BTN_LT"), "2:11: dead_man: 'BTN_LT' is no button; allowed: BTN_0"),
        (("BTN_TL", "BTN_TL2"), "2:11: Microsoft X-Box 360 pad has no BTN_TL2; allowed: BTN_SOUTH"),
        (("BTN_TL\n", "BTN_EAST\n"), "3:8: BTN_EAST is dead_man already; a button has one meaning"),
        (("ABS_X}", "ABS_Z}"), "5:13: ABS_Z of Microsoft X-Box 360 pad is at an end of its range: a trigger"),
        (("dead_man: BTN_TL\n", ""), "key 'dead_man' is missing"),
        (("estop", "e_stop"), "3:1: unknown key 'e_stop'; allowed: contid_gamepad"),
        (("ABS_X}", "ABS_THROTTLE}"), "5:13: Microsoft X-Box 360 pad has no ABS_THROTTLE; allowed: ABS_X"),
        (("ABS_X}", "ABS_X, scale: 2}"), "5:27: scale: allowed is a number at most 1"),
        (("ABS_X}", "ABS_X, dead_band: 0}"), "dead_band: allowed is a number at least 0.01"),
        (("axes:\n  - {input: ABS_X}\n", ""), "nothing moves"),
        ((GOOD, "[]"), "1:1: the file is no mapping of keys to values"),
    ],
)
def test_mistakes_have_their_place(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    path = tmp_path / "pad.yaml"
    path.write_text(GOOD.replace(*change))
    with pytest.raises(BadInputError) as caught:
        read_mapping(path, XBOX)
    assert str(caught.value).startswith(f"{path}:")
    assert message in str(caught.value)


def test_what_was_found_is_listed(tmp_path: Path) -> None:
    with pytest.raises(ContidError, match=r"no gamepad or 3D mouse was found among:\n  no device in "):
        find_device(tmp_path)
    os.mkfifo(tmp_path / "event3")
    with pytest.raises(ContidError, match=r"event3: is no input device"):
        find_device(tmp_path)


def test_mistakes_of_the_command_are_named(tmp_path: Path) -> None:
    for arguments, message in (
        (("jog", "--gamepad", "finger"), "write the robot first: contid jog finger --gamepad [DEVICE]"),
        (("jog", "finger", "--gamepad", str(tmp_path / "none")), "none: cannot be opened: No such file"),
        (("jog", "finger", "--gamepad", "/dev/null"), "/dev/null: is no input device"),
        (("jog", "finger", "--mapping", "pad.yaml"), "give --gamepad too"),
    ):
        done = contid(*arguments)
        assert done.returncode == 2
        assert message in done.stderr
