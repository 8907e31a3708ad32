"""`Sim` against `contid run --virtual` and `contid replay` in other processes, and the limits of the file."""

from __future__ import annotations

import csv
import pickle
import re
import threading
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from contid import Robot, Session, Sim
from contid.errors import ContidError
from contid.session.format.entries import GROWING
from contid.session.write import SessionWriter
from contid_library import simulated
from tests.support.command import contid_in


def contid(folder: Path, *arguments: str, rows: str = "") -> str:
    done = contid_in(folder, *arguments, stdin=rows)
    assert done.returncode == 0, done.stderr
    return done.stdout


def ramp(step: int) -> dict[str, float]:
    """Rows for a hand: slow enough to follow, then too fast, then out of reach for a while."""
    x = 10.0 + 0.1 * step + (20.0 if step > 150 else 0.0) + (500.0 if 200 < step < 220 else 0.0)
    return {"left.x_mm": x, "left.y_mm": 80.0, "right.left_mm": 55.0 + 0.05 * step, "right.right_mm": 60.0}


@pytest.mark.process
def test_the_commands_are_those_of_a_run_in_virtual_time(tmp_path: Path) -> None:
    rows = [ramp(step) for step in range(300)]
    text = ",".join(rows[0]) + "\n" + "".join(",".join(map(repr, row.values())) + "\n" for row in rows)
    contid(tmp_path, "run", "hand", "--virtual", "--log", "log.csv", rows=text)
    with (tmp_path / "log.csv").open() as file:
        printed = {int(line["tick"]): line for line in csv.DictReader(file)}
    with Sim("hand", si=True) as sim:
        # A run gives the first row in the tick in which every robot is armed.
        assert sim.state.tick == 2
        compared = 0
        for row in rows:
            state = sim.step(row)
            line = printed[state.tick]
            for name, robot in state.robots.items():
                assert line[f"{name}.mode"] == robot.mode
                assert [float(line[f"{name}.{axis}.command"]) for axis in ("left", "right")] == list(
                    robot.command
                )
            compared += 1
    assert compared == 300


@pytest.mark.process
def test_a_recording_replays_bit_for_bit(tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    with Sim("hand", record=file) as sim:
        for step in range(100):
            sim.step(ramp(step))
        sim.hold()
        sim.step(ticks=50)
        sim.resume()
        sim.step(ticks=50)
    assert "bit for bit" in contid(tmp_path, "replay", str(file))
    with pytest.raises(ContidError, match="file exists; recordings are never overwritten"):
        Sim("hand", record=file)


def test_a_refused_simulation_leaves_no_recording(tmp_path: Path) -> None:
    with pytest.raises(ContidError, match="nearest points"):
        Sim("hand", unreachable="nearest", record=tmp_path / "run.mcap")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("at", ["begin", "end"])
def test_a_simulation_that_fails_releases_its_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at: str
) -> None:
    """A file that stayed locked would be taken for one that is being recorded, and not be repaired."""

    def fails(*_: object, **__: object) -> None:
        raise ContidError("it fails")

    sim = Sim("finger")
    if at == "begin":
        monkeypatch.setattr(simulated, "VirtualProcess", fails)
    else:
        monkeypatch.setattr(SessionWriter, "flush", fails)
    with pytest.raises(ContidError, match="it fails"):
        Sim("finger", record=tmp_path / "run.mcap").close()
    session = Session(tmp_path / "run.mcap")
    assert not list(session.ticks())
    assert session.end.cut != GROWING
    sim.close()


@pytest.mark.parametrize("name", ["finger", "tendon3"])
def test_a_state_goes_to_another_process(name: str) -> None:
    with Sim(name) as sim:
        there = pickle.loads(pickle.dumps(sim.state))
        assert there.tick == sim.state.tick
        assert np.array_equal(there[sim.names[0]].tip, sim.state[sim.names[0]].tip)


def test_steps_keep_the_rates_of_the_file() -> None:
    with Sim("finger") as sim:
        limits = Robot("finger").limits
        commands = [sim.step([30.0, 90.0]).robots["finger"].command for _ in range(400)]
        speeds = np.diff(commands, axis=0) * sim.rate_hz
        assert np.abs(speeds).max() <= limits.velocity * (1.0 + 1e-9)
        assert np.abs(speeds).max() > 0.5 * limits.velocity
        assert np.abs(np.diff(speeds, axis=0) * sim.rate_hz).max() <= limits.acceleration * (1.0 + 1e-6)
        end = sim.state["finger"]
        assert end.mode == "RUN"
        assert end.command.tolist() == [30.0, 90.0]
        assert end.measured == pytest.approx([30.0, 90.0], abs=0.02)
        assert end.tip == pytest.approx(Robot("finger").fk(end.measured).tip, abs=1e-9)


@pytest.mark.parametrize(
    "name",
    [
        *("hand", "trirack2", "stiffflop2", "tendon3"),
        *(pytest.param(name, marks=pytest.mark.campaign) for name in ("chain", "cbha")),
    ],
)
def test_every_robot_holds_where_it_is_armed_then_goes_to_its_rest_pose(name: str) -> None:
    robot = Robot(name)
    rest: dict[str, Any] = {each: robot[each].limits.rest for each in robot.names}
    with Sim(name) as sim:
        assert {each.mode for each in sim.state.robots.values()} == {"HOLD"}
        state = sim.step(rest, ticks=round(6 * sim.rate_hz))
    for each in robot.names:
        own = len(rest[each])
        assert state[each].mode == "RUN", state[each]
        assert state[each].command[:own] == pytest.approx(rest[each], abs=1e-6)
        assert state[each].tip == pytest.approx(robot[each].fk(rest[each]).tip, abs=2.0)


def test_a_target_out_of_reach_is_refused_and_the_robot_holds() -> None:
    with Sim("finger") as sim:
        sim.step({"x_mm": 0.0, "y_mm": 100.0}, ticks=400)
        state = sim.step({"x_mm": 0.0, "y_mm": 500.0}, ticks=100)["finger"]
        assert state.mode == "HOLD"
        assert "out of reach by 378 mm" in state.refused
        assert state.command == pytest.approx([78.0, 78.0], abs=0.1)
        good = sim.step({"x_mm": 0.0, "y_mm": 101.0}, ticks=200)["finger"]
        assert (good.mode, good.refused) == ("RUN", "")
    with Sim("finger", unreachable="nearest") as sim:
        state = sim.step({"x_mm": 0.0, "y_mm": 500.0}, ticks=600)["finger"]
        assert state.command.tolist() == [100.0, 100.0]
        assert state.residual == pytest.approx(378.0)
        assert not state.converged


def test_it_needs_no_process_and_repeats_to_the_bit() -> None:
    def commands() -> list[list[float]]:
        with Sim("hand") as sim:
            return [sim.step(ramp(step))["left"].command.tolist() for step in range(60)]

    threads, children = threading.active_count(), len(psutil.Process().children())
    assert commands() == commands()
    assert (threading.active_count(), len(psutil.Process().children())) == (threads, children)


def test_hold_and_resume() -> None:
    with Sim("finger") as sim:
        sim.step([40.0, 80.0], ticks=20)
        sim.hold()
        held = sim.step(ticks=100)["finger"]
        assert held.mode == "HOLD"
        sim.resume()
        assert sim.step(ticks=300)["finger"].command.tolist() == [40.0, 80.0]
        kinds = [type(event).__name__ for event in sim.events]
        assert "ModeChanged" in kinds


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ({"lft": [1, 2]}, "no robot 'lft'; allowed: left, right; did you mean 'left'?"),
        ([1, 2], "several robots: name them"),
        ({"left": [1, 2, 3]}, "actuation of left has shape (3,); expected: (2,)"),
        ({"left": [[1, 2]]}, "actuation of left has shape (1, 2); a step takes one row"),
        ({}, "no robot and no column; allowed: left, right"),
        ({"left.x_mm": 3}, "column 'left.x_mm' needs 'left.y_mm' beside it"),
        ({"left.x_mm": 3, "left.z_mm": 4}, "unknown column 'left.z_mm'"),
        ({"left.x_mm": "a", "left.y_mm": 1}, "left.x_mm: 'a' is not a number"),
        ({"left.x_mm": float("nan"), "left.y_mm": 1}, "left.x_mm is nan"),
        ({"left.x_mm": 10**400, "left.y_mm": 1}, "left.x_mm: the number is too large; at most 1e+10"),
        ({"left": [1, 10**400]}, "actuation of left: an array of numbers is needed"),
        ({"left.x_mm": [1, [2]], "left.y_mm": 1}, "no robot 'left.x_mm'; allowed: left, right"),
        ({1: 5.0}, "unknown column '1'"),
    ],
)
def test_mistakes_in_a_step(command: Any, message: str) -> None:
    with Sim("hand") as sim:
        tick = sim.state.tick
        with pytest.raises(ValueError, match=re.escape(message)):
            sim.step(command)
        assert sim.state.tick == tick


def test_a_closed_simulation_and_bad_options() -> None:
    sim = Sim("finger")
    sim.close()
    sim.close()
    with pytest.raises(ContidError, match="closed"):
        sim.step()
    with pytest.raises(ContidError, match="did you mean 'finger'"):
        Sim("fingr")
    with pytest.raises(ContidError, match="rate_hz=-5"):
        Sim("finger", rate_hz=-5)
