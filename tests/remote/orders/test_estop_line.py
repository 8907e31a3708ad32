"""Every spelling of an emergency stop stops; no other request does."""

from __future__ import annotations

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contid.remote.protocol.wire import is_estop
from tests.support.daemons import armed, daemon, raw
from tests.support.waiting import until

pytestmark = pytest.mark.process

SPELLINGS = [
    b'{"id":1,"verb":"estop"}',
    b'{"id":7.0,"verb":"estop"}',
    b'{"id":[1],"verb":"estop"}',
    b'{"id":{"a":1},"verb":"estop"}',
    b'{"id":"' + b"x" * 201 + b'","verb":"estop"}',
    b'{"id":NaN,"verb":"estop"}',
    b'{"verb":"estop","rate":NaN}',
    b'{"verb":"estop","rate":1e999999}',
    b'\xef\xbb\xbf{"id":1,"verb":"estop"}',
    b'{"id":1,"verb":"ESTOP"}',
    b'{"id":1,"verb":" estop "}',
    b'{"id":1,"verb":"e-stop"}',
    b'{"id":1,"verb":"emergency_stop"}',
    b'{"id":1,"verb":["estop"]}',
    b'{"id":1,"Verb":"estop"}',
    b"{'id':1,'verb':'estop'}",
    b'{"id":1,"verb":"estop","robots":"f0"}',
    b'{"id":1,"verb":"estop","robots":["unknown"]}',
    b'{"id":1,"verb":"estop","verb":"status"}',
    b'{"id":1,"verb":"estop"',
    b'{"id":1,"verb":"\\u0065stop"}',
    b'{"id":1,"\\u0076erb":"\\u0065\\u0053TOP"',
    b'{"id":1,"verb":"estop","why":"\xff\xfe"}',
    b'["estop"]',
    b"estop",
    b"ESTOP\r",
    '{"id":1,"verb":"estop"}'.encode("utf-16-be"),
]
OTHERS = [
    b'{"id":1,"verb":"status"}',
    b'{"id":1,"verb":"hello","name":"estop button"}',
    b'{"id":1,"verb":"hello","name":"\\"verb\\":\\"estop\\""}',
    b'{"id":1,"verb":"stop"}',
    b'{"id":1,"verb":"move","target":{"estop":1}}',
    b"garbage",
    b"",
]


@pytest.mark.parametrize("line", SPELLINGS)
def test_a_spelling_of_estop_is_recognised(line: bytes) -> None:
    assert is_estop(line + b"\n")


@pytest.mark.parametrize("line", OTHERS)
def test_another_request_is_no_estop(line: bytes) -> None:
    assert not is_estop(line + b"\n")


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)


@settings(max_examples=40, deadline=None)
@given(
    st.dictionaries(st.text(max_size=8).filter(lambda key: key != "verb"), JSON, max_size=5), st.booleans()
)
def test_no_other_field_hides_the_verb(fields: dict[str, object], last: bool) -> None:
    before, after = ({}, fields) if last else (fields, {})
    assert is_estop(json.dumps({**before, "verb": "estop", **after}).encode())


@given(st.binary(max_size=300))
def test_any_bytes_are_judged(line: bytes) -> None:
    assert is_estop(line) in (True, False)


@pytest.mark.realtime
def test_a_daemon_obeys_every_spelling_and_answers() -> None:
    with daemon() as running, running.client() as client:
        for line in SPELLINGS:
            client.resume(after_stop=True)
            armed(client)
            with raw(running) as connected:
                connected.recv(1 << 16)  # hello
                connected.sendall(line + b"\n")
                answer = connected.recv(1 << 16)
                assert b'"ok":true' in answer or b"all robots were stopped" in answer, (line, answer)
            until(running.off, f"{line!r} stops")
        # A client that leaves without an end of line, and a line without end.
        for data in (b'{"verb":"estop"}', b'{"verb":"estop","x":"' + b"x" * (1 << 17)):
            client.resume(after_stop=True)
            armed(client)
            with raw(running) as connected:
                connected.sendall(data)
            until(running.off, "it stops")
