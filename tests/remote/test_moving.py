"""What a client moves arrives, and what cannot be reached is refused before anything moves."""

from __future__ import annotations

import json
import re
import signal
import subprocess
from typing import Any

import pytest

from contid.client import AsyncClient, Code, ConnectionLostError, RemoteError
from contid.remote.protocol.wire import decode, encode
from tests.support.daemons import HERE, Running, armed, arrives, command, daemon, raw, states
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]


def test_a_session_of_a_client() -> None:
    with daemon(2) as running, running.client(name="day") as client:
        armed(client)
        robot = client.describe()["robots"]["f0"]
        assert robot["columns"][:2] == ["x_mm", "y_mm"]
        assert robot["axes"]["left"] == {"min_mm": 0.0, "max_mm": 100.0}
        client.move({"f0.x_mm": 50.0, "f0.y_mm": 75.0, "f1.x_mm": 50.0, "f1.y_mm": 80.0})
        arrives(client, "f0", (50.0, 75.0, 0.0))
        arrives(client, "f1", (50.0, 80.0, 0.0))
        status = client.status()
        assert status["lease"]["holder"] == "day"
        assert status["buses"]["bus0"]["tier"] in {"fresh", "late"}
        live = [(50.0 + 0.02 * step, 75.0) for step in range(50)]
        assert client.stream(["f0.x_mm", "f0.y_mm"], live) == []
        arrives(client, "f0", (50.98, 75.0, 0.0))
        timed = [(0.02 * step, 50.98 - 0.02 * step, 75.0) for step in range(50)]
        assert client.stream(["t_s", "f0.x_mm", "f0.y_mm"], timed) == []
        frames = client.telemetry(100.0, robots="f0", fields=["state", "tip_mm"], events=True)
        seen = [next(frames) for _ in range(8)]
        ticks = [frame["tick"] for frame in seen if frame["event"] == "telemetry"]
        assert ticks == sorted(set(ticks))
        frames.close()
        client.stop()
        until(lambda: states(client) == {"OFF"}, "every robot rests")
        client.resume()
        assert states(client) == {"HOLD"}, "a move that ended is not taken up again"
        client.estop()
        until(running.off, "every device is without torque")
        report = json.loads(_ended(running))
    assert report["exit_code"] == 130


def _ended(running: Running) -> str:
    running.process.send_signal(signal.SIGTERM)
    out, _ = running.process.communicate(timeout=30)
    return out


def test_targets_that_are_wrong_or_out_of_reach_are_named_and_nothing_moves() -> None:
    with daemon() as running, running.client() as client:
        armed(client)
        before = client.status()["robots"]["f0"]["tip_mm"]
        for target, code in (
            ({"x_mm": 500.0, "y_mm": 75.0}, Code.UNREACHABLE),
            ({"x_mm": 50.0}, Code.BAD_TARGET),
            ({"z_mm": 50.0}, Code.BAD_TARGET),
            ({"x_mm": "far", "y_mm": 75.0}, Code.BAD_TARGET),
            ({}, Code.BAD_TARGET),
        ):
            with pytest.raises(RemoteError) as refused:
                client.move(target)  # type: ignore[arg-type]
            assert refused.value.code == code
        with pytest.raises(RemoteError) as refused:
            client.stream(["t_s", "x_mm", "y_mm"], [(0.0, 50.0, 75.0), (1.0, 500.0, 75.0)])
        assert refused.value.code == Code.BAD_TARGET
        assert "rows:3" in str(refused.value)
        with pytest.raises(RemoteError) as refused:
            client.hold("thumb")
        assert refused.value.code == Code.UNKNOWN_ROBOT
        assert client.status()["robots"]["f0"]["tip_mm"] == pytest.approx(before, abs=0.5)
        client.estop()
        with pytest.raises(RemoteError) as refused:
            client.move(HERE)
        assert refused.value.code == Code.NOT_ARMED


def test_rows_beyond_the_credit_are_refused_and_credit_comes_back() -> None:
    with daemon() as running, running.client() as client:
        armed(client)
        begun = client.request("move", columns=["x_mm", "y_mm"])
        with pytest.raises(RemoteError) as refused:
            client.request("rows", move=begun["move"], rows=[[50.0, 75.0]] * (begun["credits"] + 1))
        assert refused.value.code == Code.NO_CREDIT
        result = client.request("rows", move=begun["move"], rows=[[50.0, 75.0], [500.0, 75.0]])
        assert "out of reach" in result["refused"][0]
        refusals = client.stream(["x_mm", "y_mm"], ((50.0, 75.0) for _ in range(100)))
        assert refusals == []


async def test_the_asyncio_client_does_the_same() -> None:
    with daemon() as running:
        async with AsyncClient(running.socket, name="async") as client:
            with running.client() as other:
                armed(other)
            await client.move(HERE)

            async def rows() -> Any:
                for step in range(40):
                    yield (50.0 + 0.02 * step, 75.0)

            assert await client.stream(["x_mm", "y_mm"], rows()) == []
            seen = []
            frames = client.telemetry(100.0, fields=["tip_mm"])
            async for frame in frames:
                seen.append(frame["robots"]["f0"]["tip_mm"])
                if len(seen) == 3:
                    break
            await frames.aclose()
            assert all(len(tip) == 3 for tip in seen)
            await client.estop()
            assert running.off()
            running.process.send_signal(signal.SIGTERM)
            running.process.wait(30)
            with pytest.raises(ConnectionLostError):
                await client.ping()


def test_the_commands_talk_to_the_daemon() -> None:
    with daemon() as running, running.client() as client:
        armed(client)
        client.release()

        def contid(*arguments: str, stdin: str = "") -> subprocess.CompletedProcess[str]:
            asked = [*command(*arguments), "--socket", str(running.socket)]
            return subprocess.run(asked, capture_output=True, text=True, input=stdin)

        assert contid("move", "f0", "x_mm=50", "y_mm=75").returncode == 0
        shown = contid("status")
        assert shown.returncode == 0
        assert re.search(r"f0  HOLD  tip \(", shown.stdout)
        assert "bus0" in shown.stdout
        assert json.loads(contid("status", "--json").stdout)["robots"]["f0"]["state"] == "HOLD"
        rows = "t_s,x_mm,y_mm\n0,50,75\n0.5,51,75\n"
        followed = contid("move", "--trajectory", "-", stdin=rows)
        assert followed.returncode == 0, followed.stderr
        wrong = contid("move", "x_mm=500", "y_mm=75")
        assert wrong.returncode == 2
        assert "out of reach" in wrong.stderr
        refused = contid("move", "--trajectory", "-", stdin="x_mm,y_mm\n50,75\n500,75\n")
        assert refused.returncode == 2
        assert re.match("contid: refused: stdin:3: .* is out of reach", refused.stderr), refused.stderr
        (running.folder / "far.csv").write_text("# far away\nt_s,x_mm,y_mm\n0,50,75\n\n0.5,500,75\n")
        far = contid("move", "--trajectory", str(running.folder / "far.csv"))
        assert far.returncode == 2
        assert far.stderr.startswith(f"contid: {running.folder / 'far.csv'}:5:1: "), far.stderr
        (running.folder / "live.csv").write_text("x_mm,y_mm\n50,75\n51,75\n")
        at_once = contid("move", "--trajectory", str(running.folder / "live.csv"))
        assert at_once.returncode == 2
        assert "live.csv:1:1: no column 't_s'" in at_once.stderr
        (running.folder / "utf16.csv").write_text("x_mm,y_mm\n50,75\n", encoding="utf-16")
        garbled = contid("move", "--trajectory", str(running.folder / "utf16.csv"))
        assert garbled.returncode == 2
        assert "is this UTF-8 text?" in garbled.stderr
        assert contid("hold").stdout == "f0: HOLD\n"
        assert contid("estop", "f0").stdout == "f0: OFF\n"
        assert contid("resume", "--json").returncode == 0
        assert contid("clear-fault").returncode == 0
        assert contid("stop", "--end").returncode == 0
        assert running.process.wait(30) == 130
        assert contid("status").returncode == 2


def test_granted_rows_are_taken_without_waiting_for_responses() -> None:
    """A client that sends all it was granted so far, and looks at responses later, is never refused."""
    count = 300
    with daemon() as running, running.client() as watcher, raw(running) as connected:
        armed(watcher)
        lines = connected.makefile("rb")
        send = connected.sendall
        send(encode({"id": 1, "verb": "move", "columns": ["x_mm", "y_mm"]}))
        granted = sent = answered = 0
        move, errors = 0, []
        while answered < count:
            fields = decode(lines.readline())
            result = fields if fields.get("event") == "credit" else fields.get("result", {})
            move = result.get("move", move)
            assert result.get("granted", granted) >= granted, "the sum never falls"
            granted = result.get("granted", granted)
            answered += (fields.get("id") or 0) > 1
            errors += [fields] if fields.get("ok") is False else []
            while sent < min(granted, count):
                sent += 1
                send(encode({"id": sent + 1, "verb": "rows", "move": move, "rows": [[50.0, 75.0]]}))
        assert not errors
        send(encode({"id": 0, "verb": "rows", "move": move, "rows": [[50.0, 75.0]] * 9}))
        while (fields := decode(lines.readline())).get("id") != 0:
            pass
        assert fields["error"]["code"] == Code.NO_CREDIT
