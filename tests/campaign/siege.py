"""A real daemon whose socket gets garbage: it refuses it, moves nothing, stays small, serves others.

A client of ours, the guard, holds the lease, so whatever is sent may at most stop robots; after some
attacks it looks at everything the daemon shows, and arms again what was stopped.
"""

from __future__ import annotations

import json
import random
import shutil
import signal
import socket as sockets
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from contid.client import Client
from contid.errors import ContidError
from contid.remote.protocol.socket_path import is_listening
from contid.units import MAX_LINE
from tests.support.daemons import armed
from tests.support.fingers import fingers
from tests.support.waiting import until

#: Deliberate bugs, as code that runs before `contid run`: a protection less, which an attack has to notice.
BUGS: dict[str, str] = {
    "errors of the parser are not caught": (
        "import json, contid.remote.server.connection as c\nc.decode = json.loads"
    ),
    "lines without a limit": "import contid.remote.server.line_receiver as r; r.MAX_LINE = 1 << 30",
    "a hold that moves": (
        "import contid.remote.server.stop_orders as v\n"
        "async def hold(self, caller, request):\n"
        "    target = {'f0.x_mm': 40.0, 'f0.y_mm': 80.0}\n"
        "    return await self._moves.point(caller.number, target, caller.notify)\n"
        "v.StopOrders._hold = hold"
    ),
}

#: Bytes that daemon and control process may grow by: 64 clients with a line and answers each take a tenth.
GROWTH = 48 << 20
#: Attacks between two looks of the guard: most stop robots, and a stopped robot shows no move until armed.
EVERY = 5
#: A simulated servo that holds trembles by its resolution [mm].
STILL_MM = 0.1
START = "from contid.cli.main import main; main()"
LAST = b'{"id":"last","verb":"ping"}\n'

#: Requests of every verb that can move nothing: their targets have columns that no robot has, and none takes
#: over or ends the run.
REQUESTS: tuple[dict[str, Any], ...] = (
    {"verb": "hello", "protocol": 1, "name": "other"},
    {"verb": "ping"}, {"verb": "status"}, {"verb": "describe"},
    {"verb": "subscribe", "rate_hz": 50, "robots": ["f0"], "fields": ["state", "tip_mm"], "events": True},
    {"verb": "unsubscribe"},
    {"verb": "hold", "robots": ["f1"]}, {"verb": "stop", "robots": ["f0"]}, {"verb": "estop"},
    {"verb": "acquire", "timeout_s": 1.0}, {"verb": "release"}, {"verb": "resume", "robots": ["f0"]},
    {"verb": "clear_fault"}, {"verb": "move", "target": {"f0.u_mm": 50.0, "f0.v_mm": 75.0}},
    {"verb": "move", "columns": ["t_s", "f0.u_mm", "f0.v_mm"]},
    {"verb": "rows", "move": 7, "rows": [[50.0, 75.0], [51.0, 75.0]]}, {"verb": "end", "move": 7},
    {"verb": "measure", "robot": "f0", "tip_mm": [50.0, 75.0], "direction": [0.0, 1.0], "age_ms": 1.0},
)  # fmt: skip


def line(fields: object) -> bytes:
    return json.dumps(fields).encode() + b"\n"


CORPUS = tuple(b"".join(line({"id": i, **each}) for i, each in enumerate(some)) for some in (
    REQUESTS, *((each,) for each in REQUESTS), REQUESTS[::-1],
))  # fmt: skip

#: Sent once each, in every campaign.
BOMBS: dict[str, bytes] = {
    "nesting of lists": b"[" * 60_000,
    "nesting of objects": b'{"id":1,"verb":"status","x":' + b'{"a":' * 10_000,
    "nesting that is closed": b'{"verb":"move","target":' + b'{"a":' * 9_000 + b"1" + b"}" * 9_001,
    "a number of many digits": b'{"id":' + b"9" * 60_000 + b',"verb":"ping"}',
    "numbers that are none": b'{"verb":"acquire","timeout_s":NaN}\n{"verb":"acquire","timeout_s":-Infinity}',
    "numbers beyond all": (
        b'{"verb":"acquire","timeout_s":1e999}\n{"verb":"rows","move":1e999,"rows":[[1e999]]}'
    ),
    "the same key again": b'{"verb":"estop","verb":"ping","id":1,"id":2}',
    "half of a character": b'{"id":"\\ud800","verb":"hello","name":"\\udfff"}',
    "zeros in names": b'{"id":"\\u0000","verb":"\\u0000","robots":["\\u0000"]}',
    "controls of a terminal": b'{"verb":"hello","name":"\\u001b[2J\\u001b]0;x\\u0007"}\n{"verb":"acquire"}',
    "another encoding": '{"id":1,"verb":"ping"}\n'.encode("utf-16"),
    "a byte order mark": b"\xef\xbb\xbf" + b'{"id":1,"verb":"ping"}',
    "no requests": b"\n" * 5_000,
    "many rows": line({"verb": "rows", "move": 1, "rows": [[0.0]] * 9_000}),
    "many names": line({"verb": "hold", "robots": ["f"] * 9_000}),
    "many keys": line({"verb": "ping", **{str(n): n for n in range(4_000)}}),
    "a line that is too long": b'{"verb":"' + b"x" * (4 * MAX_LINE) + b'"}',
    "a line without end": b"x" * (64 << 20),
}  # fmt: skip


@dataclass
class Siege:
    """A daemon under attack."""

    process: subprocess.Popen[bytes]
    socket: Path
    stderr: Path
    guard: Client
    place: list[float] = field(default_factory=list)
    least: int = 0
    most: int = 0
    attacks: int = 0

    def attack(self, data: bytes) -> None:
        """Send bytes as a client of its own; the daemon answers a last request, or sends it away."""
        self.attacks += 1
        cut = zlib.crc32(data) % 8 == 0
        with sockets.socket(sockets.AF_UNIX) as connected:
            connected.settimeout(10.0)
            connected.connect(str(self.socket))
            if cut:
                # Gone in the middle of a line, with every answer unread.
                with suppress(OSError):
                    connected.sendall(data)
            else:
                self._talk(connected, data + b"\n" + LAST)
        if self.attacks % EVERY == 0:
            self.look()

    def _talk(self, connected: sockets.socket, data: bytes) -> None:
        connected.setblocking(False)
        received, unsent, until_s = b"", memoryview(data), time.monotonic() + 20.0
        while b'"id":"last"' not in received[-4096:]:
            assert time.monotonic() < until_s, f"no answer after {data[:200]!r}"
            try:
                while unsent:
                    unsent = unsent[connected.send(unsent[: 1 << 16]) :]
            except BlockingIOError:
                pass
            except OSError:
                unsent = unsent[:0]  # sent away; why is still to be read
            try:
                got = connected.recv(1 << 16)
            except BlockingIOError:
                time.sleep(0.0002)
                continue
            except OSError:
                break
            if not got:
                break
            received += got
        *whole, rest = received.split(b"\n")
        assert len(rest) < MAX_LINE
        for answer in whole:
            response = json.loads(answer, parse_constant=_none)
            assert "event" in response or (response["ok"] in (True, False) and "id" in response), answer
            assert response.get("ok", True) or response["error"]["message"].strip(), answer

    def look(self) -> None:
        """What the guard sees: the daemon lives, reported no defect, did not grow; nothing moved."""
        assert self.process.poll() is None, "the daemon ended"
        stderr = self.stderr.read_text(errors="replace")
        for word in ("Traceback", "Error:", "exception was never retrieved", "never awaited"):
            assert word not in stderr, stderr[max(stderr.find(word) - 500, 0) :][:3000]
        self.most = max(self.most, self._memory())
        assert self.most - self.least < GROWTH, f"it grew by {(self.most - self.least) >> 20} MB"
        robots = self.guard.status()["robots"]
        place = [axis["measured_mm"] for robot in robots.values() for axis in robot["axes"].values()]
        moved = max(abs(a - b) for a, b in zip(place, self.place, strict=True))
        assert moved < STILL_MM, f"an axis moved by {moved} mm"
        if any(robot["state"] != "HOLD" for robot in robots.values()):
            self.rearm()

    def rearm(self) -> None:
        self.guard.acquire(60.0, takeover=True)
        self.guard.clear_fault()  # a machine that stood still looks like a dead bus
        self.guard.resume(after_stop=True)
        armed(self.guard)

    def _memory(self) -> int:
        """The most that daemon and control process ever had in memory [bytes]."""
        daemon = psutil.Process(self.process.pid)
        pids = [daemon.pid, *(child.pid for child in daemon.children(recursive=True))]
        status = [Path(f"/proc/{pid}/status").read_text() for pid in pids]
        return sum(int(each.split("VmHWM:")[1].split()[0]) << 10 for each in status)

    def flood(self, requests: int, read: bool) -> int:
        """Small requests in one connection; returns how many were answered."""
        small = LAST.replace(b"last", b"more")
        with sockets.socket(sockets.AF_UNIX) as connected:
            connected.connect(str(self.socket))
            connected.setblocking(False)
            unsent, answered, until_s = memoryview(small * requests), 0, time.monotonic() + 120.0
            while answered < requests and time.monotonic() < until_s:
                try:
                    with suppress(BlockingIOError):
                        while unsent:
                            unsent = unsent[connected.send(unsent[: 1 << 16]) :]
                    while read and (got := connected.recv(1 << 20)):
                        answered += got.count(b'"id":"more"')
                    if not read and not unsent:
                        break
                except BlockingIOError:
                    time.sleep(0.001)
                except OSError:
                    break  # sent away
                if not read:
                    time.sleep(0.001)
                    if self.process.poll() is not None or time.monotonic() > until_s - 114.0:
                        break
        self.look()
        return answered


def _none(name: str) -> float:
    raise AssertionError(f"{name} in an answer")


@contextmanager
def siege(bug: str = "") -> Iterator[Siege]:
    """`contid run` on two simulated fingers, armed and holding; ``bug`` is code of `BUGS`."""
    # Short: the path of a socket has 107 bytes.
    folder = Path(tempfile.mkdtemp(prefix="contid-"))
    robot, place, stderr = folder / "fingers.yaml", folder / "s", folder / "stderr"
    robot.write_text(fingers(2))
    with stderr.open("wb") as errors:
        process = subprocess.Popen(
            [sys.executable, "-c", f"{bug}\n{START}", "run", str(robot), "--socket", str(place)],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=errors,
        )  # fmt: skip
    try:
        until(lambda: is_listening(place) or process.poll() is not None, "the daemon listens")
        assert process.poll() is None, stderr.read_text()
        with Client(place, name="guard") as guard:
            # On a busy machine the control process takes longer to start than an order waits.
            until(lambda: guard.status()["tick"] is not None, "the control process runs")
            made = Siege(process, place, stderr, guard)
            made.rearm()
            robots = guard.status()["robots"]
            made.place = [a["measured_mm"] for robot in robots.values() for a in robot["axes"].values()]
            made.attack(CORPUS[0])  # whatever is imported or made only once
            made.least = made._memory()
            yield made
            made.look()
        process.send_signal(signal.SIGTERM)
        assert process.wait(10) == 130, stderr.read_text()
        assert "Traceback" not in stderr.read_text()
    finally:
        if process.poll() is None:
            process.kill()
        process.wait()
        shutil.rmtree(folder, ignore_errors=True)


def campaign(
    rounds: int,
    seed: int,
    mutate: Callable[[bytes, random.Random], bytes],
    floods: int = 100_000,
    bug: str = "",
) -> list[tuple[bytes, str]]:
    """Bombs, mutated requests, and floods of small ones; violations as `bad_input.campaign` has them."""
    dice, found = random.Random(f"socket:{seed}"), []
    try:
        with siege(bug) as under:
            for data in (*BOMBS.values(), *(mutate(dice.choice(CORPUS), dice) for _ in range(rounds))):
                try:
                    under.attack(data)
                except (AssertionError, ContidError, OSError) as error:
                    found.append((data, f"{type(error).__name__}: {error}"))
                    if under.process.poll() is not None or len(found) > 20:
                        break
            assert under.flood(floods, read=True) == floods, "requests without an answer"
            under.flood(floods, read=False)
    except AssertionError as error:
        found.append((b"", f"AssertionError: {error}"))
    return found
