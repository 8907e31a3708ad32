"""Recordings that clients begin and end during a run: whole files, under names of the daemon."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
from mcap.reader import make_reader

from contid.client import Client, RemoteError
from tests.support.command import contid_in
from tests.support.daemons import FAR, HERE, Running, armed
from tests.support.daemons import fast_daemon as daemon
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    with daemon(1, "--recordings", str(tmp_path)) as started:
        with started.client() as client:
            armed(client)
        yield started


def _listed(client: Client) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = client.status()["recordings"]
    return found


def _begun(client: Client) -> Path:
    path = Path(client.record()["file"])
    until(
        lambda: "recording" in [each["state"] for each in _listed(client) if each["file"] == str(path)],
        "it records",
    )
    return path


def _messages(path: Path, topic: str) -> list[dict[str, Any]]:
    """Read by the reader of the MCAP project."""
    with path.open("rb") as file:
        return [json.loads(message.data) for _, _, message in make_reader(file).iter_messages([topic])]


def _complete(client: Client, path: Path) -> Path:
    until(lambda: str(path) not in [each["file"] for each in _listed(client)], "the file is complete")
    return path


def test_two_recordings_of_one_run(running: Running, tmp_path: Path) -> None:
    paths = []
    with running.client(name="person", timeout_s=60.0) as client:
        for target in (FAR, HERE):
            path = _begun(client)
            assert path.parent == tmp_path
            assert path.name.startswith("fingers-")
            (listed,) = _listed(client)
            assert (listed["file"], listed["by"], listed["whole_run"]) == (str(path), "person", False)
            client.move(target)
            assert client.record(end=True)["file"] == str(path)
            paths.append(_complete(client, path))
    assert len({*paths}) == 2
    first, second = (_messages(path, "tick") for path in paths)
    for ticks in (first, second):
        # A busy machine may skip a tick; the recording then has that, and misses no other.
        assert [tick["tick"] - tick["skipped"] for tick in ticks] == list(
            range(ticks[0]["tick"] - ticks[0]["skipped"], ticks[-1]["tick"] - ticks[-1]["skipped"] + 1)
        )
        assert len(ticks) > 10
    assert first[0]["tick"] > 0
    assert second[0]["tick"] > first[-1]["tick"]
    for path, target in zip(paths, (FAR, HERE), strict=True):
        orders = [event for event in _messages(path, "event") if event["event"] == "order"]
        assert str(target["x_mm"] / 1000) in json.dumps(orders[0])
    done = contid_in(tmp_path, "session", "info", paths[1].name)
    assert done.returncode == 0, done.stderr
    assert "clean" in done.stdout
    assert "0 skipped" in done.stdout
    assert contid_in(tmp_path, "session", "check", paths[1].name).returncode == 0
    done = contid_in(tmp_path, "replay", paths[1].name)
    assert done.returncode == 2
    assert "begins during a run" in done.stderr


def test_what_cannot_be_recorded_is_refused(running: Running, tmp_path: Path) -> None:
    with (
        running.client(name="first", timeout_s=60.0) as first,
        running.client(name="second", timeout_s=60.0) as second,
    ):
        with pytest.raises(RemoteError, match="there is no recording"):
            first.record(end=True)
        path = _begun(first)
        with pytest.raises(RemoteError, match="begun by first; end it first"):
            second.record()
        with pytest.raises(RemoteError, match=r"unknown field 'file'"):
            second.request("record", file="/etc/passwd")
        assert second.record(end=True)["file"] == str(path)  # any client may end it
        assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_a_recording_outlives_its_client_and_ends_with_the_run(running: Running, tmp_path: Path) -> None:
    with running.client(timeout_s=60.0) as client:
        path = _begun(client)
    with running.client(timeout_s=60.0) as client:
        assert [each["file"] for each in _listed(client)] == [str(path)]
    running.end()
    ticks = [tick["tick"] for tick in _messages(path, "tick")]
    assert ticks == list(range(ticks[0], ticks[-1] + 1))
    assert any(event["event"] == "robot" for event in _messages(path, "event"))


def test_a_recorder_that_fails_is_reported_and_the_run_goes_on(running: Running) -> None:
    with running.client(timeout_s=60.0) as client:
        _begun(client)
        children = psutil.Process(running.process.pid).children()
        (recorder,) = [each for each in children if "contid.session.mcap_recorder" in each.cmdline()]
        os.kill(recorder.pid, signal.SIGKILL)
        until(lambda: not _listed(client), "it is listed no more")
        until(
            lambda: any("the recorder ended" in each["message"] for each in client.status()["warnings"]),
            "it is reported",
        )
        client.move(FAR)
        path = _begun(client)
        client.record(end=True)
        _complete(client, path)
    assert _messages(path, "tick")


def test_the_recording_of_the_whole_run_is_listed_and_stays(tmp_path: Path) -> None:
    whole = tmp_path / "whole.mcap"
    with daemon(1, "--recordings", str(tmp_path), "--record", str(whole)) as running:
        with running.client(timeout_s=60.0) as client:
            armed(client)
            assert [(each["file"], each["whole_run"]) for each in _listed(client)] == [(str(whole), True)]
            with pytest.raises(RemoteError, match="no recording that was begun by an order"):
                client.record(end=True)
            path = _begun(client)
            assert len(_listed(client)) == 2
            client.move(FAR)
            client.record(end=True)
            _complete(client, path)
            assert [each["file"] for each in _listed(client)] == [str(whole)]
        running.end()
    assert contid_in(tmp_path, "replay", "whole.mcap").returncode == 0
    part = {tick["tick"] for tick in _messages(path, "tick")}
    assert part < {tick["tick"] for tick in _messages(whole, "tick")}
