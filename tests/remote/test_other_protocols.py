"""Stops across protocol versions, both ways: recorded lines of each against client and daemon of today.

``protocols/N.txt`` was recorded between `contid hold`, `stop`, `estop` and a daemon of protocol N, with the
code of that protocol; ``other`` is a client of another protocol at its hello.
"""

from __future__ import annotations

import json
import socket
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from contid.client import AsyncClient, Client, Code, RemoteError
from contid.control.orders import REQUESTS
from contid.remote.protocol.wire import PROTOCOL, STOP_VERBS
from tests.support.daemons import armed, command, daemon, raw, states

pytestmark = [pytest.mark.process, pytest.mark.realtime]

RECORDED = {int(path.stem): path.read_text() for path in Path(__file__).parent.glob("protocols/*.txt")}
#: A protocol to come: nothing is known of it but its greeting, its refusal and its stops.
TO_COME = max(RECORDED) + 7


def exchanges(protocol: int) -> list[tuple[str, dict[str, Any], dict[str, Any]]]:
    """Who asks, its line and the response."""
    lines = [line.partition(" ")[::2] for line in RECORDED[min(protocol, max(RECORDED))].splitlines()[1:]]
    pairs = zip(lines[::2], lines[1::2], strict=True)
    return [(who, json.loads(asked), json.loads(answer)) for (who, asked), (_, answer) in pairs]


class OldDaemon:
    """Answers as a daemon of another protocol did, and keeps what it was asked."""

    def __init__(self, path: Path, protocol: int) -> None:
        self.path, self.asked = path, list[dict[str, Any]]()
        self._greeting = {"event": "hello", "protocol": protocol, "version": "?", "name": "fingers"}
        self._answers = {
            asked["verb"]: answer for who, asked, answer in exchanges(protocol) if who == "client"
        }
        self._refusal = next(answer for who, _, answer in exchanges(protocol) if who == "other")
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.bind(str(path))
        self._socket.listen()
        self._protocol = protocol
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        while True:
            client, _ = self._socket.accept()
            with client, client.makefile("rwb", buffering=0) as lines:
                lines.write(json.dumps(self._greeting).encode() + b"\n")
                for line in lines:
                    asked = json.loads(line)
                    if asked["verb"] == "end of test":
                        return
                    self.asked.append(asked)
                    strange = asked["verb"] == "hello" and asked["protocol"] != self._protocol
                    answer = self._refusal if strange else self._answers[asked["verb"]]
                    lines.write(json.dumps({**answer, "id": asked["id"]}).encode() + b"\n")

    def close(self) -> None:
        with socket.socket(socket.AF_UNIX) as last:
            last.connect(str(self.path))
            last.sendall(b'{"verb":"end of test"}\n')
            self._thread.join()
        self._socket.close()


@contextmanager
def old_daemon(folder: Path, protocol: int) -> Iterator[OldDaemon]:
    found = OldDaemon(folder / "s", protocol)
    try:
        yield found
    finally:
        found.close()


OTHERS = [each for each in (*RECORDED, TO_COME) if each != PROTOCOL]


def test_every_protocol_is_recorded_and_has_the_same_stops() -> None:
    assert sorted(RECORDED) == list(range(1, PROTOCOL + 1))
    assert {verb for verb, request in REQUESTS.items() if request.stops} == set(STOP_VERBS)
    for protocol in RECORDED:
        asked = {line["verb"]: line for who, line, _ in exchanges(protocol) if who == "client"}
        for verb in STOP_VERBS:
            assert {key: value for key, value in asked[verb].items() if value} == {"id": 2, "verb": verb}


@pytest.mark.parametrize("protocol", OTHERS)
async def test_a_client_of_today_stops_a_daemon_of_another_protocol(own_folder: Path, protocol: int) -> None:
    with old_daemon(own_folder, protocol) as old:
        with Client(old.path) as client:
            for verb in STOP_VERBS:
                assert getattr(client, verb)()["robots"]
                assert old.asked[-1] == {"id": old.asked[-1]["id"], "verb": verb}
            client.estop("f0")
            assert old.asked[-1] == {"id": old.asked[-1]["id"], "verb": "estop", "robots": ["f0"]}
            for order in (client.resume, client.status, lambda: client.move({"x_mm": 1.0})):
                with pytest.raises(RemoteError, match=f"daemon has protocol {protocol}") as refused:
                    order()
                assert refused.value.code == Code.PROTOCOL
        async with AsyncClient(old.path) as other:
            assert (await other.estop())["robots"] == {"f0": "OFF"}
            with pytest.raises(RemoteError, match=f"daemon has protocol {protocol}"):
                await other.resume()
        assert {line["verb"] for line in old.asked} == {"hello", *STOP_VERBS}


@pytest.mark.parametrize("verb", STOP_VERBS)
def test_the_commands_stop_a_daemon_of_another_protocol(own_folder: Path, verb: str) -> None:
    with old_daemon(own_folder, TO_COME) as old:
        done = subprocess.run(
            command(verb, "f0", "--socket", str(old.path)), capture_output=True, text=True, timeout=30
        )
        assert (done.returncode, done.stderr) == (0, "")
        assert "f0: " in done.stdout
        assert old.asked[-1]["verb"] == verb


def test_clients_of_every_protocol_stop_a_daemon_of_today() -> None:
    with daemon() as running, running.client() as client:
        for protocol in (*RECORDED, TO_COME):
            for verb in STOP_VERBS:
                client.acquire()
                client.resume()
                armed(client)
                asked = [line for who, line, _ in exchanges(protocol) if who == "client"]
                hello = {**asked[0], "protocol": protocol}
                stop = next(line for line in asked if line["verb"] == verb)
                with raw(running) as other, other.makefile("rb") as lines:
                    assert json.loads(lines.readline())["event"] == "hello"
                    for line in (hello, stop):
                        other.sendall(json.dumps(line).encode() + b"\n")
                        answer = json.loads(lines.readline())
                assert answer["ok"], answer
                assert client.status()["lease"]["stopped_by"].endswith(f"({verb})")
                assert states(client) <= ({"HOLD"} if verb == "hold" else {"STOPPING", "OFF"})
