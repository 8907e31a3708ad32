"""Random live streams keep every limit and end at rest on their last row, in a short form."""

from __future__ import annotations

from dataclasses import replace

import pytest

from contid.control.tick.jerk_guard import guarded
from contid.targets import Target
from tests.campaign.live.random_streams import ROBOTS, campaign, rows_of, skips_of, staged, violations

#: Streams that exceeded the jerk of their robot by 2.6 to 24 times, or did not come to rest.
FOUND = (
    ("stiffflop1", 2000195),  # a valve that closes ended 1e-6 Pa beyond its limit
    ("stiffflop1", 2000393),  # a stop of an axis that accelerates
    ("trirack", 1000015),  # a stop that crosses a bend radius early
    ("trirack2", 1000003),  # a way along a bend radius
    ("stiffflop1", 44000348),  # a way of 1.2e-4 Pa that counted as none: 8e-4 beyond the jerk
    ("stiffflop1", 4000307),  # rows that became slower: the curve was played backwards and never came to rest
)


@pytest.mark.parametrize(("robot", "number"), FOUND)
def test_streams_that_exceeded_a_limit_keep_it(robot: str, number: int) -> None:
    stage = staged(robot)
    assert violations(stage, rows_of(stage, number)) == {}


def test_a_recording_of_rules_1_goes_on_as_it_was() -> None:
    """By its rules the first of these streams exceeds the jerk, by as much as when it was found."""
    stage = staged("stiffflop1")
    before = stage._replace(config=replace(stage.config, motion_rules=1))
    assert violations(before, rows_of(stage, 2000195))["jerk"] == pytest.approx(24.347013, rel=1e-4)


#: A command 1e-7 m inside a bend radius of the second arm of `trirack2`, and a row on it.
SHORT_OF_A_ROW = (
    0.4340793004872183, 0.26784948238526196, 0.4324752950828621,
    0.35591796233684053, 0.24144637519110387, 0.335524146054434,
)  # fmt: skip
ROW_ON_A_LIMIT_M = (0.04060156226346279, 4.4997027498008824e-05, -0.16847578533031882)


@pytest.mark.parametrize(("motion_rules", "moves"), [(2, False), (3, True)])
def test_a_row_on_a_shared_limit_is_reached_from_beside_it(motion_rules: int, moves: bool) -> None:
    """By rules 2 the straight line to it led 3e-12 m beyond the limit: the robot stayed 6 um off.

    With rows that differ by 1e-16 m stream 3000095 ended there, or did not come to rest.
    """
    stage = staged("trirack2")
    config = replace(stage.config, motion_rules=motion_rules)
    answer = config.model.inverse(Target(tip_m=ROW_ON_A_LIMIT_M), SHORT_OF_A_ROW).actuation
    still = replace(stage.state, command=SHORT_OF_A_ROW, before=(0.0,) * 6, reference=answer)
    assert (guarded(config, still, answer).command != SHORT_OF_A_ROW) is moves


def test_random_streams_keep_every_limit_and_end_on_their_last_row() -> None:
    tally = campaign(("finger", "cbha"), 4, seed=5)
    assert not tally.counts, tally.table()
    assert tally.streams.total() == 4


def test_a_row_that_repeats_the_last_one_after_a_stall_is_arrived_at() -> None:
    """It began a clock without a period while the curve was on its way, where the robot then stood."""
    stage, number = staged("stiffflop2"), 11001325
    assert violations(stage, rows_of(stage, number), skips_of(number)) == {}


def test_rows_that_come_amid_a_stop_do_not_keep_the_robot_from_its_end() -> None:
    """They ended the stop each time that the phase passed the last row, for ever."""
    stage, number = staged("ftdcr_v4"), 65000159
    assert violations(stage, rows_of(stage, number), skips_of(number)) == {}


def test_they_do_while_ticks_are_skipped() -> None:
    tally = campaign(("finger", "trirack"), 6, seed=7, skips=True)
    assert not tally.counts, tally.table()


@pytest.mark.campaign
@pytest.mark.parametrize("skips", [False, True])
def test_streams_of_every_robot(skips: bool) -> None:
    tally = campaign(ROBOTS, 400, seed=6, skips=skips)
    assert not tally.counts, tally.table()
