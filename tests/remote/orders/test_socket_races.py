"""The model of histories finds what the docs exclude, and a real server on a real socket makes none of it."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any

import pytest

from tests.remote.orders.history import History, Order
from tests.remote.orders.socket_races import socket_race, socket_races

HOLD, RUN, OFF = {"f0": "HOLD"}, {"f0": "RUN"}, {"f0": "OFF"}


def order(client: int, verb: str, at: int, answer: Mapping[str, Any] | str | None, **fields: Any) -> Order:
    """An order of the ticks ``at`` and the next one, with a result, the code of a refusal, or no answer."""
    given = Order(client, verb, fields, 2 * at, at)
    if answer is not None:
        given.answered, given.answered_tick, given.ok = 2 * at + 1, at + 1, not isinstance(answer, str)
    if isinstance(answer, str):
        given.code = answer
    else:
        given.result = answer or {}
    return given


def at(tick: int, robots: Mapping[str, str]) -> dict[str, Any]:
    return {"tick": tick, "robots": robots}


def wrong(modes: list[dict[str, str]], *orders: Order, closed: Mapping[int, int] | None = None) -> list[str]:
    found = History(orders, dict(enumerate(modes)), closed or {}).wrong()
    return [each.partition(":")[0].partition(" in tick")[0] for each in found]


STOPPED = order(1, "hold", 1, at(1, HOLD))
HOLDS = [HOLD] * 12


def test_a_sound_history_has_nothing_wrong() -> None:
    modes = [HOLD] * 7 + [RUN] * 3
    assert wrong(
        modes,
        STOPPED,
        order(2, "resume", 3, "stopped"),
        order(2, "acquire", 5, {}),
        order(2, "resume", 7, at(7, RUN)),
    ) == []  # fmt: skip
    assert wrong(HOLDS, STOPPED, order(1, "resume", 3, at(3, HOLD)), order(2, "resume", 5, at(5, HOLD))) == []


@pytest.mark.parametrize(
    ("modes", "orders", "found"),
    [
        (HOLDS, [STOPPED, order(2, "resume", 3, at(3, HOLD))], ["moved after a stop"]),
        (
            HOLDS,
            [STOPPED, order(3, "resume", 3, "refused", after_stop=True), order(2, "resume", 5, at(5, HOLD))],
            ["moved after a stop"],
        ),
        (
            HOLDS,
            [STOPPED, order(2, "acquire", 3, {}), order(3, "resume", 5, "stopped")],
            ["refused though no stop stands"],
        ),
        ([HOLD] * 5 + [RUN] * 5, [STOPPED], ["began to move"]),
        (
            [HOLD, RUN, HOLD, HOLD, RUN],
            [order(2, "move", 1, {"tick": 1}), order(1, "hold", 2, at(2, HOLD))],
            ["answered with a foreign tick", "began to move"],
        ),
        (HOLDS, [order(1, "hold", 1, at(1, RUN))], ["answered with foreign states"]),
        (HOLDS, [order(1, "hold", 3, at(1, HOLD))], ["answered with a foreign tick"]),
        (HOLDS, [order(1, "estop", 1, at(1, HOLD))], ["an estop was lost"]),
        (HOLDS, [order(1, "estop", 1, "bad-request")], ["an estop was lost"]),
        (HOLDS, [order(1, "release", 1, None)], ["never answered"]),
        (
            HOLDS,
            [order(1, "acquire", 1, {}, timeout_s=60.0), order(2, "move", 3, {"tick": 3})],
            ["moved without the lease"],
        ),
        (
            HOLDS,
            [order(1, "acquire", 1, {}), order(1, "release", 3, {}), order(2, "move", 5, "lease-held")],
            ["refused though the lease is free"],
        ),
    ],
)  # fmt: skip
def test_what_the_docs_exclude_is_found(
    modes: list[dict[str, str]], orders: list[Order], found: list[str]
) -> None:
    expected = [each for each in found if each != "answered with a foreign tick" or len(found) == 1]
    assert [each for each in wrong(modes, *orders) if each in expected] == expected


def test_an_estop_of_a_client_that_left_is_obeyed() -> None:
    left = order(1, "estop", 1, None)
    assert wrong([HOLD] * 3 + [OFF] * 3, left, closed={1: 9}) == []
    assert wrong([HOLD] * 80, left, closed={1: 9}) == ["an estop was lost"]


def test_raced_orders_on_a_socket_obey_the_docs() -> None:
    wrong, answers = asyncio.run(socket_race(250, 8, 1))
    assert wrong == []
    assert sum(answers[f"{verb}:True"] for verb in ("move", "resume", "acquire")) > 20, answers


@pytest.mark.campaign
@pytest.mark.timeout(7200)
def test_many_raced_orders_on_a_socket_obey_the_docs() -> None:
    assert socket_races(20_000, 1) == []
