"""What keys move in each space of a jog, and the columns and values from which it begins."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from contid.client import Client, Code, RemoteError
from contid.remote.client.described_robot import DescribedRobot
from contid_hands.teleop.jog_session import JogSession
from contid_hands.teleop.jog_space import JogSpace, Space

RATES = (20.0, 100.0, 1000.0)


def robot(*bends: str, tip: int = 3) -> DescribedRobot:
    axes = ("arm.s1.l1_mm", "arm.s1.l2_mm", "arm.wrist_deg")
    return DescribedRobot(
        robot="arm", axes=axes, minimum=(0.0, 0.0, -90.0), maximum=(100.0, 100.0, 90.0),
        tip=("arm.x_mm", "arm.y_mm", "arm.z_mm")[:tip], bends=tuple(f"arm.{each}" for each in bends),
        unit="mm", units=("mm", "mm", "deg"), rates=RATES, axis_rates=(RATES, RATES, (180.0, 1e3, 1e4)),
        estop="relax",
    )  # fmt: skip


SPATIAL = ("s1.bend_deg", "s1.azimuth_deg", "s2.bend_deg", "s2.azimuth_deg", "s2.length_mm")


def test_keys_move_the_chosen_section() -> None:
    space = JogSpace(robot(*SPATIAL), axes=False, tip_mm_s=None)
    assert space.direction("up") == (1, 1)
    space.go_on()
    assert space.columns == tuple(f"arm.{each}" for each in SPATIAL)
    assert [space.direction(key) for key in ("up", "left", "r", "x")] == [(0, 1), (1, -1), None, None]
    space.choose(1)
    assert [space.direction(key) for key in ("down", "right", "f")] == [(2, -1), (3, 1), (4, -1)]
    space.choose(2)  # there is no third one
    assert space.section == 1
    assert space.label(0.1) == "bends s2: 10 deg/s, step 1 deg"
    jogger = space.jogger([10.0, 0.0, 20.0, 0.0, 60.0], 0.5)
    jogger.press(2, 1.0, 0.0)
    jogger.press(3, -1.0, 0.0)
    assert jogger.advance(0.2) == pytest.approx([10.0, 0.0, 22.0, -6.0, 60.0])
    space.go_on()
    space.choose(1)
    assert (space.space, space.axis, space.direction("left")) == (Space.AXES, 1, (1, -1))
    space.go_on()
    assert space.space is Space.TIP


def test_a_robot_whose_name_ends_like_a_section_has_no_more_sections() -> None:
    named = replace(robot(), bends=("arms4.s1.bend_deg", "arms4.s2.bend_deg"))
    space = JogSpace(named, axes=False, tip_mm_s=None)
    space.go_on()
    space.choose(3)
    assert (space.section, space.direction("up")) == (0, (0, 1))
    space.choose(1)
    assert (space.section, space.direction("up")) == (1, (1, 1))


def test_the_label_has_the_speed_that_is_driven() -> None:
    space = JogSpace(robot(), axes=False, tip_mm_s=500.0)
    assert space.jogger([0.0, 0.0, 0.0], 0.1).speed == RATES[0]
    assert space.label(0.1) == "tip: 20 mm/s, step 2 mm"


def test_a_planar_section_bends_by_either_pair_of_keys() -> None:
    space = JogSpace(robot("s1.bend_deg", "s1.length_mm", tip=2), axes=False, tip_mm_s=5.0)
    assert space.direction("r") is None
    assert space.label(0.1) == "tip: 5 mm/s, step 0.5 mm"
    space.go_on()
    assert [space.direction(key) for key in ("right", "up", "r")] == [(0, 1), (0, 1), (1, 1)]


def test_a_jog_begins_at_what_was_commanded_last() -> None:
    space = JogSpace(robot(), axes=False, tip_mm_s=None)
    assert space.spaces == [Space.TIP, Space.AXES]
    state = {"command_tip_mm": [1.0, 2.0, 3.0], "command": [5.0, None, 0.0], "bends": None}
    assert space.begin(state) == [1.0, 2.0, 3.0]
    space.go_on()
    assert space.begin(state) is None
    assert space.begin({**state, "command": None}) is None


def test_a_speed_is_kept_by_space() -> None:
    space = JogSpace(robot(*SPATIAL), axes=True, tip_mm_s=None)
    space.change_speed(False, None, 0.1)
    assert space.label(0.1).startswith("axes arm.s1.l1_mm: 3 mm/s")
    space.choose(2)
    assert space.label(0.1).startswith("axes arm.wrist_deg: 27 deg/s")
    space.go_on()
    assert space.label(0.1).startswith("tip: 10 mm/s")


def test_a_digit_that_is_no_number_chooses_nothing() -> None:
    """The key "²" of a French keyboard."""
    chosen: list[int] = []
    session = cast(JogSession, SimpleNamespace(space=SimpleNamespace(choose=chosen.append)))
    for key in ("²", "0", "2"):
        JogSession._other(session, key, None)
    assert chosen == [1]


def test_a_stop_is_stated_as_it_was_taken() -> None:
    """A refused one is not stated, and axes that may have missed it are named."""
    lines: list[str] = []
    answers: list[dict[str, Any] | RemoteError] = [
        {"robots": {"arm": "STOPPING"}},
        {"robots": {"arm": "STOPPING"}, "silent": {"arm": ["arm.s1.l1"]}},
        RemoteError(Code.NO_ANSWER, "the control process did not confirm"),
    ]

    def stop(_robot: str) -> dict[str, Any]:
        answer = answers.pop(0)
        if isinstance(answer, RemoteError):
            raise answer
        return answer

    session = object.__new__(JogSession)
    session.robot = robot()
    session._client = cast(Client, SimpleNamespace(stop=stop, acquire=lambda _timeout_s: None))
    session._log = lines.append
    session._stop()
    assert lines == ["arm: STOP. e resumes"]
    session._stop()
    assert "arm.s1.l1 did not answer and may have missed it" in lines[-1]
    session._stop()
    assert "did not confirm" in lines[-1]
    assert len(lines) == 4
