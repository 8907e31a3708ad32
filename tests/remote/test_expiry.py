"""What has failed for the caller of a client moves nothing when the daemon goes on."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from contid.client import Client, RemoteError
from contid.remote.client.client_protocol import ClientProtocol
from contid.remote.protocol.expiry import FIELD, LASTING, clock_s
from contid.remote.protocol.wire import ConnectionLostError, decode
from tests.support.daemons import FAR, HERE, Running, armed, daemon, states


@contextmanager
def stopped(running: Running, pause_s: float) -> Iterator[None]:
    """The daemon stands still during the block and for a while longer."""
    os.kill(running.process.pid, signal.SIGSTOP)
    try:
        yield
        time.sleep(pause_s)
    finally:
        os.kill(running.process.pid, signal.SIGCONT)


def _commands_mm(client: Client) -> list[float]:
    return [axis["command_mm"] for axis in client.status()["robots"]["f0"]["axes"].values()]


@pytest.mark.process
@pytest.mark.realtime
@pytest.mark.parametrize("order", ["move", "resume"])
def test_an_order_that_had_no_response_is_not_carried_out_later(order: str) -> None:
    give: dict[str, Callable[[Client], object]] = {
        "move": lambda client: client.move(FAR, wait=False),
        "resume": lambda client: client.resume(),
    }
    with daemon(1) as running:
        with running.client() as client:
            armed(client)
            client.move(HERE)
            before = _commands_mm(client)
        with running.client(timeout_s=0.4) as hasty:
            if order == "resume":
                hasty.estop()
            with stopped(running, 0.3), pytest.raises(ConnectionLostError, match="no response within"):
                give[order](hasty)
            time.sleep(0.5)
        with running.client() as client:
            assert _commands_mm(client) == before or order == "resume"
            assert states(client) == {"OFF" if order == "resume" else "HOLD"}


@pytest.mark.process
@pytest.mark.realtime
def test_an_order_may_be_valid_for_less_than_its_response_is_waited_for() -> None:
    with daemon(1) as running, running.client(timeout_s=20.0, valid_s=1.0) as client:
        armed(client)
        with stopped(running, 0.0):
            request = client._procedures._protocol.request("resume", {})
            client._procedures._wire.send(request)  # type: ignore[union-attr]
            time.sleep(1.5)
        client._procedures._read(5.0)
        with pytest.raises(RemoteError, match="too late") as refused:
            client._procedures._protocol.result(request)
        assert refused.value.code == "expired"


def test_what_only_ends_something_never_expires() -> None:
    protocol = ClientProtocol(10.0, 1.0)
    for verb in ("move", "rows", "end", "resume", "recover", "acquire", "status"):
        fields = decode(protocol.request(verb, {}).line.strip())
        assert 0.0 < fields[FIELD] - clock_s() <= 1.0
    for verb in LASTING:
        assert FIELD not in decode(protocol.request(verb, {}).line.strip())
    assert {"hold", "stop", "estop"} <= LASTING


def test_a_daemon_of_another_machine_gets_no_time_of_this_clock() -> None:
    assert FIELD not in decode(ClientProtocol(10.0).request("move", {}).line.strip())
