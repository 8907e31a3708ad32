"""Lines of the socket and the fields of a request."""

from __future__ import annotations

import json
import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid.remote.protocol.wire import RemoteError, RequestFields, decode, encode


@given(st.binary(max_size=400))
def test_any_bytes_are_an_object_or_a_refusal(line: bytes) -> None:
    try:
        found: object = decode(line)
    except RemoteError as error:
        found = {"code": error.code}
    assert isinstance(found, dict)


@pytest.mark.parametrize("line", [b"[" * 60_000, b"{" * 60_000, b'{"a":NaN}', b'{"a":1e', b"1" * 5000, b"[]"])
def test_traps_are_refused(line: bytes) -> None:
    with pytest.raises(RemoteError):
        decode(line)


def test_numbers_that_json_lacks_become_null() -> None:
    assert json.loads(encode({"a": float("nan"), "b": [float("inf"), 1.5]})) == {"a": None, "b": [None, 1.5]}


def test_an_unknown_field_is_refused() -> None:
    take = RequestFields({"id": 1, "verb": "hold", "robot": "left"})
    assert take.names("robots") is None
    with pytest.raises(RemoteError, match="'robot'"):
        take.end()


@pytest.mark.parametrize(
    ("take", "right", "wrong"),
    [
        (lambda take: take.text("x", ""), ["", "a" * 200], [1, None, ["a"], "a" * 201]),
        (lambda take: take.number("x", 1.0, 0.0, 2.0), [0, 1.5, 2], [-0.1, 2.1, True, "1", None, math.nan]),
        (lambda take: take.flag("x"), [True, False], [1, "true", None]),
        (lambda take: take.names("x"), [["a", "b"], []], ["a", [1], {"a": 1}]),
        (lambda take: take.mapping("x"), [{}, {"a": 1}, None], [[], 1, "a", False]),
        (lambda take: take.rows("x"), [[], [[1, 2.5]], [[]]], [None, {}, [1], [["1"]], [[True]], [[None]]]),
    ],
    ids=["text", "number", "flag", "names", "mapping", "rows"],
)
def test_a_field_of_another_kind_is_refused_by_name(
    take: Callable[[RequestFields], object], right: list[object], wrong: list[object]
) -> None:
    for value in right:
        found = take(RequestFields({"x": value}))
        assert (list(found) if isinstance(found, tuple) else found) == value
    for value in wrong:
        with pytest.raises(RemoteError, match=r"^x: "):
            take(RequestFields({"x": value}))
