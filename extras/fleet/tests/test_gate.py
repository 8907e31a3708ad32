"""The gate: rights by verb, no smuggled verbs, and an emergency stop that always passes."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid.remote.protocol.wire import RemoteError
from contid_fleet.gate import checked
from contid_fleet.keys import Keys
from contid_fleet.rights import NEEDED, STOPS, Right

KEYS = Keys("lab")
OPERATORS = {
    "anna": [*Right],
    "bob": [Right.WATCH],
    "mo": [Right.MOVE],
    "al": [Right.ARM],
    "tr": [Right.MEASURE],
}


def ask(verb: str, operator: str = "anna", payload: bytes = b"{}", node: str = "h") -> None:
    checked(KEYS, KEYS.do(node, operator, "s", verb), payload, OPERATORS)


def code(*arguments: object, **keys: object) -> str:
    with pytest.raises(RemoteError) as refusal:
        ask(*arguments, **keys)  # type: ignore[arg-type]
    return refusal.value.code


@pytest.mark.parametrize("operator", [*OPERATORS, "stranger"])
@pytest.mark.parametrize("verb", sorted(NEEDED))
def test_a_verb_passes_with_its_right_only(verb: str, operator: str) -> None:
    # The table of docs/fleet.md, written out.
    move = {"acquire", "release", "move", "rows", "end", "start", "note", "grip"}
    both = {"hello", "clock", "feed"}
    allowed = {
        "anna": {*NEEDED},
        "bob": {*both, "status", "describe", "ping", "subscribe", "unsubscribe"},
        "mo": {*both, *move},
        "al": {*both, "acquire", "release", "resume", "recover", "clear_fault"},
        "tr": {*both, "measure"},
        "stranger": set(),
    }[operator] | {"hold", "stop", "estop"}
    if verb in allowed:
        ask(verb, operator)
    else:
        assert code(verb, operator) == "forbidden"


@pytest.mark.parametrize("verb", ["shutdown", "interrupt", "record"])
def test_verbs_that_no_right_allows(verb: str) -> None:
    assert verb not in NEEDED
    assert code(verb) == "unknown-verb"


@pytest.mark.parametrize("verb", sorted({*NEEDED} - {"estop"}))
def test_a_verb_in_the_payload_is_refused(verb: str) -> None:
    assert code("status", "bob", json.dumps({"verb": verb}).encode()) == "bad-request"
    assert code("status", "bob", json.dumps({"id": 7}).encode()) == "bad-request"


def test_only_stops_and_reads_go_to_every_node() -> None:
    for verb in ("hold", "stop", "estop", "status", "describe", "feed"):
        ask(verb, node="*")
    for verb in {*NEEDED} - {*STOPS, "status", "describe", "feed"}:
        assert code(verb, node="*") == "wildcard"


def test_a_daemon_is_not_ended_by_network() -> None:
    assert code("stop", payload=b'{"end": true}') == "forbidden"


@pytest.mark.parametrize("payload", [b"[]", b"{", b"\xff", b'{"x": NaN}', b'{"a":"' + b"x" * 65536 + b'"}'])
def test_what_is_no_request_is_refused(payload: bytes) -> None:
    assert code("hold", payload=payload) == "bad-request"


@given(payload=st.binary(max_size=200), operator=st.text(st.characters(exclude_characters="/"), max_size=50))
def test_an_emergency_stop_always_passes(payload: bytes, operator: str) -> None:
    order, fields = checked(KEYS, f"contid/lab/*/do/{operator}/*/estop", payload, {})
    assert order.verb == "estop"
    assert isinstance(fields, dict)
