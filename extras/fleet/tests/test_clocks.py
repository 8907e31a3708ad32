"""Offsets of clocks from round trips: never outside the bound, whatever the two ways take."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid_fleet.clocks import RoundTrip, measure_offset, offset_of
from contid_fleet.operator import FleetOperator
from tests.support.fleets import Fleet
from tests.support.waiting import until

pytestmark = pytest.mark.realtime

delays = st.floats(0.0, 0.5)


@given(
    offset_s=st.floats(-1e6, 1e6),
    sent_s=st.floats(0.0, 1e6),
    ways=st.lists(st.tuples(delays, delays), min_size=1),
)
def test_the_true_offset_lies_within_the_bound(
    offset_s: float, sent_s: float, ways: list[tuple[float, float]]
) -> None:
    trips = [
        RoundTrip(sent_s + n, sent_s + n + there_s + offset_s, sent_s + n + there_s + back_s)
        for n, (there_s, back_s) in enumerate(ways)
    ]
    found = offset_of(trips)
    assert abs(found.offset_s - offset_s) <= found.bound_s + 1e-8
    assert found.bound_s == pytest.approx(0.5 * min(there_s + back_s for there_s, back_s in ways), abs=1e-8)
    assert found.here(found.there(sent_s)) == pytest.approx(sent_s, abs=1e-8)


@pytest.mark.process
def test_the_offset_of_a_node_of_this_machine_is_nothing(lab: Fleet) -> None:
    """Both processes read the one CLOCK_MONOTONIC of this machine: the truth is zero."""
    with FleetOperator(lab.bridge.operator("bob")) as operator:
        until(lambda: "hand1" in operator.nodes(), "the node has a token")
        offset = measure_offset(operator, "hand1")
    assert abs(offset.offset_s) <= offset.bound_s
