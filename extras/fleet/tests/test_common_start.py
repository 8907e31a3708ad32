"""Two daemons begin one trajectory at one time, or neither moves: `contid fleet run` in its own process."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from functools import partial
from pathlib import Path

import pytest

from contid.client import Client
from tests.support.command import contid
from tests.support.daemons import RATE_HZ, armed, arrives, command, states
from tests.support.fleets import Fleet
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]
STARTS = 4
TICK_S = 1.0 / RATE_HZ


def rows(folder: Path, seconds: float, node: str = "hand2") -> Path:
    path = folder / "both.csv"
    lines = [f"t_s,hand1/x_mm,hand1/y_mm,{node}/x_mm,{node}/y_mm"]
    for n in range(101):
        x = 30.0 + 10.0 * (3 * (n / 100) ** 2 - 2 * (n / 100) ** 3)
        lines.append(f"{seconds * n / 100:.4f},{x:.4f},80,{-x:.4f},80")
    path.write_text("\n".join(lines) + "\n")
    return path


def run(lab: Fleet, *arguments: str) -> subprocess.CompletedProcess[str]:
    return contid("fleet", "run", *arguments, "--json", "--file", str(lab.bridge.operator_file()))


@pytest.fixture(autouse=True)
def _armed(lab: Fleet) -> None:
    for each in lab.daemons.values():
        with each.client() as client:
            client.resume(after_stop=True)
            armed(client)


def test_nodes_begin_within_a_tick_and_the_bound(lab: Fleet, tmp_path: Path) -> None:
    for _ in range(STARTS):
        done = run(lab, str(rows(tmp_path, 1.0)))
        assert done.returncode == 0, done.stderr
        report = json.loads(done.stdout)
        assert report["nodes"].keys() == {"hand1", "hand2"}
        assert report["skew_ms"] <= TICK_S * 1e3 + report["bound_ms"], report
        assert report["bound_ms"] < 4.0
    for name, sign in (("hand1", 1), ("hand2", -1)):
        with lab.daemons[name].client() as client:
            arrives(client, "f0", (sign * 40.0, 80.0, 0.0))
            assert client.status()["lease"]["holder"] is None


def test_what_one_node_refuses_moves_none(lab: Fleet, tmp_path: Path) -> None:
    tips = {}
    for name, each in lab.daemons.items():
        with each.client() as client:
            tips[name] = client.status()["robots"]["f0"]["tip_mm"]
    done = run(lab, str(rows(tmp_path, 0.01)))  # too fast
    assert done.returncode == 2
    assert "hand1: check: " in done.stderr
    assert "hand2: check: " in done.stderr
    assert "nothing began" in done.stderr
    done = run(lab, str(rows(tmp_path, 1.0, node="hand3")))
    assert done.returncode == 4
    assert "no node 'hand3'" in done.stderr
    with lab.daemons["hand2"].client(name="person") as person:
        person.acquire()
        done = run(lab, str(rows(tmp_path, 1.0)))
        assert done.returncode == 2
        assert "hand2: acquire: client 'person' has held the lease" in done.stderr
        person.release()
    for name, each in lab.daemons.items():
        with each.client() as client:
            status = client.status()
            assert status["lease"]["holder"] is None, "all leases or none"
            assert status["robots"]["f0"]["tip_mm"] == pytest.approx(tips[name], abs=0.1)


def moving(client: Client) -> bool:
    return (client.status()["source_s"] or 0.0) > 0.2


@pytest.mark.parametrize(("on_one", "others"), [("hold_all", {"HOLD"}), ("go_on", {"RUN"})])
def test_when_one_node_stops_the_others_hold_or_go_on(
    lab: Fleet, tmp_path: Path, on_one: str, others: set[str]
) -> None:
    path = rows(tmp_path, 6.0)
    file = str(lab.bridge.operator_file())
    process = subprocess.Popen(
        command("fleet", "run", str(path), "--on-one", on_one, "--file", file),
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    with lab.daemons["hand1"].client(name="person") as person, lab.daemons["hand2"].client() as other:
        until(partial(moving, person), "it has begun")
        person.hold()
        if on_one == "hold_all":
            until(lambda: states(other) == others, "the other holds")
        else:
            time.sleep(0.5)
            assert states(other) == others
        out, errors = process.communicate(timeout=30)
    assert process.returncode == 4
    assert "stopped the robots" in out or "'person'" in out
    assert "not every node reached its end" in errors
    assert "hand2: began" in out
    assert ("reached its end" in out) == (on_one == "go_on")


@pytest.mark.parametrize(
    "number", [signal.SIGKILL, signal.SIGINT, signal.SIGSTOP], ids=["killed", "ctrl-c", "stopped"]
)
def test_without_its_conductor_the_fleet_holds(lab: Fleet, tmp_path: Path, number: signal.Signals) -> None:
    file = str(lab.bridge.operator_file())
    process = subprocess.Popen(
        command("fleet", "run", str(rows(tmp_path, 6.0)), "--file", file),
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        with lab.daemons["hand1"].client() as one, lab.daemons["hand2"].client() as two:
            until(lambda: moving(one) and moving(two), "both have begun")
            process.send_signal(number)
            until(lambda: states(one) == states(two) == {"HOLD"}, "both hold")
    finally:
        process.kill()
        process.wait()
