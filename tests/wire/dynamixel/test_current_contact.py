"""Contacts of a finger by the currents of emulated servos, on the wire and with the commands of a user."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contid import Session
from contid.control.engine.events.robots import ContactBegan
from contid.control.engine.wiring import wired_buses
from contid.robot_file.load import load_robot_file
from contid_emulate.dynamixel.bench import Bench
from tests.support.command import contid_in
from tests.support.waiting import until
from tests.wire.dynamixel.current_hand import hand

pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: Travel of the servos up to what they push against; 4096 ticks are 37.7 mm of rack.
FREE_TICKS = 500.0
FREE_MM = FREE_TICKS / 4096.0 * 37.7


@pytest.mark.parametrize("policy", [pytest.param("hold", marks=pytest.mark.campaign), "stop", "retract"])
def test_a_finger_that_meets_something_reacts(tmp_path: Path, configs: Path, policy: str) -> None:
    hand(tmp_path, configs, policy)
    (bus,) = wired_buses(load_robot_file(tmp_path / "hand.yaml"))

    def left() -> dict[str, Any]:
        done = contid_in(tmp_path, "status", "--socket", "s.sock", "--json").stdout
        robots: dict[str, Any] = json.loads(done)["robots"] if done else {}
        found: dict[str, Any] = robots.get("left", {})
        return found

    bench = Bench(bus.wiring.name, bus.wiring.options, bus.axes)  # type: ignore[arg-type]
    with bench:
        run = subprocess.Popen(
            [sys.executable, "-m", "contid", "run", "hand.yaml", "--socket", "s.sock", "--json", "--record",
             "s.mcap"],
            cwd=tmp_path, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, env=os.environ.copy(),
        )  # fmt: skip
        try:
            until(lambda: left().get("state") == "HOLD", "the finger holds", 90.0)
            motions = [servo.motion for servo in bench.emulator.servos[:2]]
            free = [(each.position - FREE_TICKS, each.position + FREE_TICKS) for each in motions]
            for motion, stops in zip(motions, free, strict=True):
                motion.stops = stops
            goal = ("left.left_mm=80", "left.right_mm=80")
            moved = contid_in(tmp_path, "move", *goal, "--socket", "s.sock")
            until(lambda: left().get("state") == ("FAULT" if policy == "stop" else "HOLD"), "it stands")
            if policy == "retract":
                inside = [(low + 1.0, high - 1.0) for low, high in free]
                until(
                    lambda: all(a < m.goal < b for m, (a, b) in zip(motions, inside, strict=True)),
                    "it went back",
                )
        finally:
            run.send_signal(signal.SIGINT)
            out, _ = run.communicate(timeout=60)
    assert moved.returncode != 0
    session = Session(tmp_path / "s.mcap")
    contacts = [event for event in session.events() if isinstance(event, ContactBegan)]
    assert {each.robot for each in contacts} == {"left"}
    assert {each.axis for each in contacts} <= {"left", "right", "left, right"}
    first = contacts[0]
    # Both racks grow, so the tip moves away from the base, along +y, and is pushed back.
    assert first.direction[1] < -0.1
    assert first.excess_ma > 50.0
    assert first.confidence > 0.9
    rows = list(session)
    racks = np.array([[row["command.left.left_mm"], row["command.left.right_mm"]] for row in rows])
    racks = racks[np.isfinite(racks).all(axis=1)]
    begin, end = racks[0], racks[-1]
    stop = begin + FREE_MM
    if policy == "retract":
        assert (end < stop).all()
    else:
        assert (end < 79.0).all()
        assert (end > begin + 1.0).all()
    if policy == "stop":
        assert "304" in out
