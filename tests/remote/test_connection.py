"""One connection on a socket pair: every request gets a response."""

from __future__ import annotations

import asyncio
import errno
import itertools
import json
import os
import random
import signal
import socket
import threading
from contextlib import AsyncExitStack
from typing import Any, cast

import pytest

from contid.remote.protocol.wire import STOP_VERBS
from contid.remote.server.connection import Connection
from contid.remote.server.query_handler import Subscription
from contid.remote.server.request_handler import RequestHandler
from contid.remote.server.turns import MAX_PENDING, Turns


class FailingHandler:
    """A handler on a host without space."""

    @property
    def queries(self) -> FailingHandler:
        return self

    def hello(self) -> dict[str, Any]:
        return {"event": "hello"}

    async def serve(self, caller: object, fields: dict[str, Any]) -> dict[str, Any]:
        raise OSError(errno.ENOSPC, "No space left on device")


class OrderHandler(FailingHandler):
    """A handler that keeps what it gets, in order."""

    def __init__(self) -> None:
        self.got: list[str] = []
        self.stops = self

    def estop_before_turn(self, caller: object, line: bytes) -> None:
        self.got.append("estop before its turn")

    def estop_all(self, caller: object) -> None:
        self.got.append("estop at the end")

    async def serve(self, caller: object, fields: dict[str, Any]) -> dict[str, Any]:
        self.got.append(fields["verb"])
        return {}


@pytest.mark.parametrize("parts", [1, 5, 1000])
def test_a_stop_is_obeyed_when_it_arrives_and_again_in_its_order(parts: int) -> None:
    """Another client has the turn, and requests of the same client wait before the stop."""
    lines = b'{"id":1,"verb":"status"}\n{"id":2,"verb":"resume"}\n{"id":3,"verb":"estop"}\n'

    async def order() -> list[str]:
        server, client = socket.socketpair()
        client.setblocking(False)
        handler, turns = OrderHandler(), Turns()
        connection = Connection(1, cast(RequestHandler, handler), turns)
        loop = asyncio.get_running_loop()
        await loop.connect_accepted_socket(lambda: connection.receiver, server)
        run = asyncio.create_task(connection.run())
        other = AsyncExitStack()
        await other.enter_async_context(turns.turn(more_wait=False))
        size = -(-len(lines) // parts)
        for begin in range(0, len(lines), size):
            await loop.sock_sendall(client, lines[begin : begin + size])
            await asyncio.sleep(0)
        while not handler.got:
            await asyncio.sleep(0)
        before = list(handler.got)
        await other.aclose()
        while "estop" not in handler.got:
            await asyncio.sleep(0)
        client.close()
        await run
        assert before == ["estop before its turn"]
        return handler.got

    got = asyncio.run(asyncio.wait_for(order(), 60.0))
    assert got == ["estop before its turn", "status", "resume", "estop"]


class SlowMoves(OrderHandler):
    """A handler whose moves are checked until the gate is open."""

    def __init__(self) -> None:
        super().__init__()
        self.gate = asyncio.Event()

    async def serve(self, caller: object, fields: dict[str, Any]) -> dict[str, Any]:
        self.got.append(fields["verb"])
        if fields["verb"] == "move":
            await self.gate.wait()
        return {}


@pytest.mark.parametrize("verb", STOP_VERBS)
@pytest.mark.parametrize("at_once", [True, False], ids=["sent together", "sent later"])
def test_a_stop_behind_more_requests_than_are_served_at_once_is_obeyed(verb: str, at_once: bool) -> None:
    """Moves that were given before it and have not begun are refused; what only reads is answered."""
    more = 8

    async def order() -> tuple[list[str], dict[int, dict[str, Any]]]:
        server, client = socket.socketpair()
        client.setblocking(False)
        handler = SlowMoves()
        connection = Connection(1, cast(RequestHandler, handler), Turns())
        loop = asyncio.get_running_loop()
        await loop.connect_accepted_socket(lambda: connection.receiver, server)
        run = asyncio.create_task(connection.run())
        verbs = ["move"] * (MAX_PENDING + more) + ["status", verb, "move", verb, "status"]
        lines = [f'{{"id":{number},"verb":"{each}"}}\n'.encode() for number, each in enumerate(verbs)]
        if at_once:
            await loop.sock_sendall(client, b"".join(lines))
        else:
            await loop.sock_sendall(client, b"".join(lines[: MAX_PENDING + 2]))
            while len(handler.got) < MAX_PENDING:
                await asyncio.sleep(0.001)
            await loop.sock_sendall(client, b"".join(lines[MAX_PENDING + 2 :]))
        while handler.got.count(verb) < 2:
            await asyncio.sleep(0.001)
        before = list(handler.got)
        handler.gate.set()
        received = b""
        while received.count(b"\n") < 1 + len(verbs):
            received += await loop.sock_recv(client, 1 << 16)
        client.close()
        await run
        answers = [json.loads(line) for line in received.splitlines()[1:]]
        return before, {answer["id"]: answer for answer in answers}

    before, answers = asyncio.run(asyncio.wait_for(order(), 60.0))
    assert before.count("move") == MAX_PENDING
    moves, rest = MAX_PENDING + more, [answers[number] for number in range(MAX_PENDING, len(answers))]
    assert all(answers[number]["ok"] for number in range(MAX_PENDING))
    refused = [answer["error"]["code"] for answer in rest if not answer["ok"]]
    assert refused == ["stopped"] * (more + 1)
    assert all(answers[moves + number]["ok"] for number in (0, 1, 3, 4))
    assert "nothing was sent" in rest[0]["error"]["message"]


@pytest.mark.parametrize("verb", STOP_VERBS)
def test_a_stop_behind_requests_that_wait_for_their_share_of_time_is_obeyed(verb: str) -> None:
    """A flood before them has used the time of clients that do not wait for responses."""

    async def order() -> list[str]:
        server, client = socket.socketpair()
        client.setblocking(False)
        handler, turns = OrderHandler(), Turns(sleep=lambda _: asyncio.sleep(3600.0))
        turns._credit_s = -1e6
        connection = Connection(1, cast(RequestHandler, handler), turns)
        loop = asyncio.get_running_loop()
        await loop.connect_accepted_socket(lambda: connection.receiver, server)
        run = asyncio.create_task(connection.run())
        verbs = ["status", "status", verb]
        await loop.sock_sendall(client, b"".join(f'{{"id":1,"verb":"{each}"}}\n'.encode() for each in verbs))
        while verb not in handler.got:
            await asyncio.sleep(0.001)
        client.close()
        run.cancel()
        await asyncio.wait([run])
        return handler.got

    assert "status" not in asyncio.run(asyncio.wait_for(order(), 60.0))


@pytest.mark.slow
def test_a_client_that_never_ceases_to_send_is_disconnected() -> None:
    """The rest of what it sent is read for a stop; what it sends meanwhile is not."""

    async def flooded() -> bool:
        server, client = socket.socketpair()
        connection = Connection(1, cast(RequestHandler, OrderHandler()), Turns())
        await asyncio.get_running_loop().connect_accepted_socket(lambda: connection.receiver, server)
        run = asyncio.create_task(connection.run())
        if not (child := os.fork()):
            try:
                chunk = (b"x" * 255 + b"\n") * 256
                while True:
                    os.write(client.fileno(), chunk)
            finally:
                os._exit(0)
        client.close()
        killer = threading.Timer(60.0, os.kill, (child, signal.SIGKILL))
        killer.start()
        try:
            await asyncio.sleep(0.05)
            connection.disconnect("enough")
            await run
        finally:
            still_sent = killer.is_alive()
            killer.cancel()
            killer.join()
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
        return still_sent

    assert asyncio.run(flooded())


def test_a_request_that_fails_with_any_error_is_answered(caplog: pytest.LogCaptureFixture) -> None:
    async def ask() -> list[dict[str, Any]]:
        server, client = socket.socketpair()
        client.setblocking(False)
        connection = Connection(1, cast(RequestHandler, FailingHandler()), Turns())
        loop = asyncio.get_running_loop()
        await loop.connect_accepted_socket(lambda: connection.receiver, server)
        run = asyncio.create_task(connection.run())
        received = b""
        for number in (1, 2):
            await loop.sock_sendall(client, b'{"id":%d,"verb":"end","move":1}\n' % number)
        while received.count(b"\n") < 3:
            received += await asyncio.wait_for(loop.sock_recv(client, 1 << 16), 60.0)
        client.close()
        await run
        return [json.loads(line) for line in received.splitlines()]

    _, first, second = asyncio.run(ask())
    assert (first["id"], second["id"]) == (1, 2)
    assert first["ok"] is False
    assert first["error"]["code"] == "internal"
    assert "No space left on device" in first["error"]["message"]
    assert "a request of client 1 failed" in caplog.text


@pytest.mark.parametrize("verb", ['["hold"]', '{"hold":1}', "7", "null", "true"])
def test_a_verb_that_is_no_text_is_answered_and_ends_nothing(verb: str) -> None:
    async def ask() -> list[dict[str, Any]]:
        server, client = socket.socketpair()
        client.setblocking(False)
        connection = Connection(1, cast(RequestHandler, FailingHandler()), Turns())
        loop = asyncio.get_running_loop()
        await loop.connect_accepted_socket(lambda: connection.receiver, server)
        run = asyncio.create_task(connection.run())
        await loop.sock_sendall(client, f'{{"id":1,"verb":{verb}}}\n{{"id":2,"verb":"hold"}}\n'.encode())
        received = b""
        while received.count(b"\n") < 3:
            chunk = await asyncio.wait_for(loop.sock_recv(client, 1 << 16), 60.0)
            assert chunk, "the connection ended"
            received += chunk
        client.close()
        await run
        return [json.loads(line) for line in received.splitlines()]

    _, *answers = asyncio.run(ask())
    assert {answer["id"] for answer in answers} == {1, 2}


@pytest.mark.parametrize(("asked_hz", "frames"), [(200.0, 1000), (150.0, 750), (100.0, 500), (20.0, 100)])
def test_a_subscription_gets_the_rate_that_it_asked_for(asked_hz: float, frames: int) -> None:
    """Records of 200 ticks a second that come up to 2 ms early or late."""
    jitter = random.Random(1)
    subscription = Subscription(asked_hz, (), (), events=False)
    sent = []
    for tick in range(1000):
        now_s = 7.0 + tick / 200.0 + jitter.uniform(-0.002, 0.002)
        if subscription.due(now_s, 1.0 / 200.0):
            subscription.sent(now_s, tick)
            sent.append(now_s)
    assert len(sent) == pytest.approx(frames, abs=2)
    assert min(after - before for before, after in itertools.pairwise(sent)) > 0.5 / asked_hz - 0.004


def test_a_subscription_of_nothing_is_never_due() -> None:
    assert not Subscription(0.0, (), (), events=True).due(1e9, 0.005)
