"""The requests of the socket are declared once; the server, the clients and recordings agree with them."""

from __future__ import annotations

import re
from typing import get_args

import pytest

from contid.client import AsyncClient, Client, RemoteError
from contid.control.engine import messages as msg
from contid.control.engine.order_events import order_event
from contid.control.orders import REQUESTS
from contid_sessions.replay.recorded_orders import order_of
from tests.support.daemons import daemon

pytestmark = pytest.mark.process

#: What the client does not offer as a method of its own: parts of its procedures.
PARTS = {"hello", "rows", "end", "note", "subscribe", "unsubscribe"}


@pytest.mark.realtime
def test_the_server_has_the_declared_requests_and_no_other() -> None:
    with daemon() as running, running.client() as client:
        with pytest.raises(RemoteError, match="unknown verb 'dance'") as refused:
            client.request("dance")
        listed = re.sub(r".*there are ", "", str(refused.value))
        assert {*listed.split(", ")} == REQUESTS.keys()
        running.end(130)


def test_the_clients_have_a_method_for_every_request() -> None:
    for client in (Client, AsyncClient):
        missing = [verb for verb in REQUESTS.keys() - PARTS if not callable(getattr(client, verb, None))]
        assert not missing, client


def test_a_stop_needs_neither_lease_nor_right_and_nothing_else_goes_without_them() -> None:
    stops = {verb for verb, request in REQUESTS.items() if request.stops}
    assert stops == {"hold", "stop", "estop"}
    for verb, request in REQUESTS.items():
        assert not (verb in stops and request.leased)
        assert (request.rights == frozenset()) == (verb in stops)
    # What moves, arms or grips needs the lease; clear_fault leaves a state that only a person may leave.
    assert {verb for verb, request in REQUESTS.items() if request.leased} == {
        *("move", "grip", "resume", "recover", "clear_fault"),
    }


def test_orders_with_plain_fields_come_back_from_their_events_by_their_names() -> None:
    special = {msg.Rows, msg.Goto, msg.Measured, msg.Play, msg.Grip, msg.Mark, msg.Start}
    plain = {*get_args(msg.Message)} - special
    assert len(plain) == 11
    for kind in plain:
        order = kind(1.5, 1.25) if kind is msg.Go else kind()
        event = order_event(order, 7)
        assert event is not None
        assert event.order["order"] == kind.NAME
        assert order_of(event) == order
