"""The short form of the bad input campaign; robot files and trajectories have their own tests beside it."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contid.errors import ContidError
from tests.campaign import bad_input, siege
from tests.campaign.corpus import stored

pytestmark = pytest.mark.campaign

ROUNDS = int(os.environ.get("CONTID_BAD_INPUTS", "60"))


@pytest.mark.parametrize("name", bad_input.TARGETS)
def test_mutated_input_is_answered(name: str) -> None:
    found = bad_input.campaign(name, ROUNDS, seed=7)
    assert not found, found[0][1]


@pytest.mark.parametrize("name", bad_input.TARGETS)
def test_stored_inputs_are_answered(name: str) -> None:
    """Each takes a way through the parser that no other takes (`tests.campaign.corpus`)."""
    inputs = stored(name)
    assert inputs
    assert {data: message for data in inputs if (message := bad_input.attempt(name, data))} == {}


@pytest.mark.parametrize("name", ["stream", "request", "dynamixel", "due", "session"])
@settings(max_examples=60, deadline=None)
@given(data=st.binary(max_size=600))
def test_any_bytes_are_answered(name: str, data: bytes) -> None:
    assert bad_input.attempt(name, data) == ""


def test_a_besieged_daemon_answers_moves_nothing_and_keeps_its_memory() -> None:
    found = siege.campaign(ROUNDS, 7, bad_input.mutated, floods=100 * ROUNDS)
    assert not found, found[0]


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=30),
    lambda inside: st.lists(inside, max_size=5) | st.dictionaries(st.text(max_size=10), inside, max_size=5),
    max_leaves=20,
)
KEYS = sorted({key for request in siege.REQUESTS for key in request})


@st.composite
def requests(draw: st.DrawFn) -> bytes:
    """A known verb whose fields are anything, but nothing that may move robots or end the run."""
    fields = dict(draw(st.sampled_from(siege.REQUESTS)))
    fields |= draw(st.dictionaries(st.sampled_from(KEYS), JSON, max_size=3))
    return siege.line(fields)


@pytest.fixture(scope="module")
def besieged() -> Iterator[siege.Siege]:
    with siege.siege() as under:
        yield under


@settings(max_examples=2 * ROUNDS, deadline=None)
@given(data=st.lists(requests(), max_size=8).map(b"".join) | st.binary(max_size=400))
def test_requests_with_any_fields_are_answered(besieged: siege.Siege, data: bytes) -> None:
    besieged.attack(data)


@pytest.mark.parametrize("bug", siege.BUGS)
def test_a_deliberate_bug_of_the_server_is_found(bug: str) -> None:
    assert siege.campaign(60, 7, bad_input.mutated, floods=0, bug=siege.BUGS[bug])


def test_a_defect_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def careless(data: bytes) -> None:
        if b"nan" in data:
            raise ValueError("could not convert")
        raise ContidError("refused")

    monkeypatch.setitem(bad_input.TARGETS, "stream", careless)
    assert bad_input.campaign("stream", 300, seed=1)


ALIASES = b"a: &a [x,x,x,x,x,x,x,x,x]\n" + b"".join(
    b"%c: &%c [%s]\n" % (98 + depth, 98 + depth, b",".join([b"*%c" % (97 + depth)] * 9)) for depth in range(9)
)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("robot_file", ALIASES),
        ("robot_file", b"[" * 50_000),
        ("robot_file", b"{a: " * 20_000),
        ("robot_file", b"rate_hz: " + b"9" * 5_000),
        ("robot_file", b"!!python/object/apply:os.system ['true']"),
        ("trajectory", b"[" * 100_000),
        ("trajectory", b"t_s," + b"x" * 1_000_000),
        ("trajectory", b't_s,left.x_mm,left.y_mm\n"' + b"9" * 5_000 + b'",1,1'),
        ("stream", b'{"left.x_mm": 1, "left.y_mm": 2}\n{"left.x_mm": ' + b"[" * 100_000),
        ("stream", b'{"left.x_mm": 1, "left.y_mm": 2}\n{"left.x_mm": ' + b"9" * 5_000 + b"}"),
        ("dynamixel", b"\xff\xff\xfd\x00" * 5_000),
        ("due", b"\x01" * 200_000),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_bombs_are_refused(name: str, data: bytes) -> None:
    assert bad_input.attempt(name, data) == ""
