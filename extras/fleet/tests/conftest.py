"""Tests of the fleet need Zenoh, and two daemons with a bridge."""

from __future__ import annotations

import queue
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec

import pytest

from tests.support.daemons import armed, as_started
from tests.support.fleets import Fleet, fleet
from tests.support.waiting import until

#: Tests that need no network.
PURE = (
    "test_daemon_link",
    "test_keys",
    "test_endpoints",
    "test_fleet_file",
    "test_gate",
    "test_common_trajectory",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Without the packages of the extra only the pure ones run."""
    if find_spec("zenoh") is None or find_spec("cryptography") is None:
        for item in items:
            if "extras/fleet/tests" in item.path.as_posix() and item.path.stem not in PURE:
                item.add_marker(pytest.mark.skip(reason="needs the extra contid[fleet]"))


@pytest.fixture(scope="session", autouse=True)
def _threads_of_zenoh(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Zenoh starts its threads once per process and keeps them: before a test counts what it leaves."""
    if find_spec("zenoh") is None:
        return
    from contid_fleet.net import NetSession
    from contid_fleet.net_settings import NetSettings

    answers: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    with tempfile.TemporaryDirectory(prefix="contid-") as folder:
        server = NetSession(NetSettings(listen=[f"unixsock-stream/{folder}/s"]))
        server.serve("contid/a", lambda question: question.answer("contid/a", b"1"))
        client = NetSession(NetSettings(connect=[f"unixsock-stream/{folder}/s"]))
        client.token("contid/token")
        until(client.peers, "the link is there")
        client.ask("contid/a", b"", 10.0, lambda _, line: answers.put(line))
        assert answers.get(timeout=10.0) == b"1"
        client.close()
        server.close()


@pytest.fixture(scope="module")
def lab() -> Iterator[Fleet]:
    with fleet() as started:
        for each in started.daemons.values():
            with each.client() as client:
                armed(client)
        yield started


@pytest.fixture(autouse=True)
def nothing_stopped_before(request: pytest.FixtureRequest) -> None:
    """A test that failed leaves robots stopped: neither its second try nor the next test begins so."""
    lab = request.getfixturevalue("lab") if "lab" in request.fixturenames else None
    for each in lab.daemons.values() if isinstance(lab, Fleet) else ():
        with each.client() as client:
            stopped = "stopped_by" in client.status()["lease"]
        if stopped:
            as_started(each)
