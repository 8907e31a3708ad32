"""Requests with a time until which they are valid: late ones are refused, stops never."""

from __future__ import annotations

import pytest

from contid.client import RemoteError
from contid.remote.protocol.expiry import clock_s
from tests.support.daemons import Running, armed_daemon, states

pytestmark = [pytest.mark.process, pytest.mark.realtime]


def code(running: Running, verb: str, **fields: object) -> str:
    """The code of a refusal, "" when the request was carried out."""
    with running.client() as client:
        try:
            client.request(verb, **fields)
        except RemoteError as error:
            return error.code
    return ""


def test_late_requests_are_refused_and_late_stops_obeyed() -> None:
    with armed_daemon(1) as running:
        late_s = clock_s() - 0.01
        target = {"x_mm": 40.0, "y_mm": 80.0}
        for verb, fields in (
            ("resume", {}), ("recover", {}), ("clear_fault", {}), ("acquire", {}), ("ping", {}),
            ("grip", {"share": 0.5}), ("move", {"target": target}), ("record", {}),
        ):  # fmt: skip
            assert code(running, verb, valid_until_s=late_s, **fields) == "expired", verb
        for no_time in ("soon", 10**400, -(10**400)):
            assert code(running, "ping", valid_until_s=no_time) == "bad-request"
        assert code(running, "ping", valid_until_s=clock_s() + 20.0) == ""
        assert code(running, "hold", valid_until_s=late_s) == ""
        assert code(running, "estop", valid_until_s=late_s) == ""
        with running.client() as client:
            assert states(client) == {"OFF"}
