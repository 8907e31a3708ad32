"""Moves until a force over the socket: a simulated finger closes on an elastic object."""

from __future__ import annotations

import pytest

from contid.client import RemoteError
from tests.support.command import contid
from tests.support.daemons import armed, daemon

pytestmark = [pytest.mark.process, pytest.mark.realtime]

BEFORE, BEHIND = {"x_mm": 30.0, "y_mm": 75.0}, {"x_mm": 55.0, "y_mm": 75.0}
LINES = """    rest_mm: [60, 60]
    sense: {contact: hold, usual_ma: 400, contact_ma: 200, nm_per_a: 0.354}
    sim: {object: {point_mm: [34, 0, 0], normal: [-1, 0, 0], stiffness_n_per_mm: 3}}
"""


def test_a_finger_holds_an_object_until_it_is_released() -> None:
    with daemon(change=lambda text: text.replace("    rest_mm: [60, 60]\n", LINES)) as run:
        with run.client() as client:
            armed(client)
            client.move(BEFORE)
            client.move(BEHIND, until_force_n=3.0)
            assert client.status()["robots"]["f0"]["state"] == "HOLD"
            client.move(BEFORE)
            with pytest.raises(RemoteError, match=r"did not arrive; f0: friction may hide"):
                client.move(BEHIND, until_force_n=0.1)
            with pytest.raises(RemoteError, match="3 mm are needed"):
                client.move({"x_mm": 31.0, "y_mm": 75.0}, until_force_n=3.0)
            for wrong in (-1.0, "much", 1e4):
                with pytest.raises(RemoteError, match="until_force_n"):
                    client.request("move", target=BEHIND, until_force_n=wrong)
            with pytest.raises(RemoteError, match="belongs to a target"):
                client.request("move", columns=["x_mm", "y_mm"], until_force_n=3.0)
        # Back before the object: the move above closed on the way.
        assert contid("move", "x_mm=30", "y_mm=75", "--socket", str(run.socket)).returncode == 0
        closed = contid("move", "x_mm=55", "y_mm=75", "--until-force-n", "3", "--socket", str(run.socket))
        assert closed.returncode == 0, closed.stderr
        pressed = contid("move", "x_mm=55", "y_mm=75", "--until-force-n", "5", "--socket", str(run.socket))
        assert pressed.returncode == 2
        assert "it holds an object" in pressed.stderr
        for arguments in (
            ("--until-force-n", "3"),
            ("f0", "--until-force-n", "3"),
            ("x_mm=3", "--until-force-n", "0"),
        ):
            assert contid("move", *arguments, "--socket", str(run.socket)).returncode == 2
        output = run.end()
    assert "holds with" in output
