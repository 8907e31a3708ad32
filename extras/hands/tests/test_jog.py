"""`contid jog` on a pseudo-terminal: keys move, their absence holds, space stops, losses have a message."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from contid.client import Client
from tests.support.command import environment
from tests.support.daemons import HERE, Running, armed, arrives, command, daemon, states
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]


class Jogging:
    """`contid jog` and the terminal it runs on."""

    def __init__(self, process: subprocess.Popen[bytes], master: int) -> None:
        self.process = process
        self._master = master
        self.output = ""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def press(self, keys: bytes, repeats: int = 1) -> None:
        for _ in range(repeats):
            os.write(self._master, keys)
            time.sleep(0.03)

    def shows(self, text: str) -> None:
        until(lambda: text in self.output or self.process.poll() is not None, f"it shows {text!r}")
        assert text in self.output, self.output[-2000:]

    def _read(self) -> None:
        try:
            while data := os.read(self._master, 4096):
                self.output += data.decode(errors="replace")
        except OSError:
            return

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self._reader.join(5.0)
        os.close(self._master)


@contextmanager
def jogging(running: Running, *arguments: str) -> Iterator[Jogging]:
    master, slave = pty.openpty()
    process = subprocess.Popen(
        [*command("jog", *arguments), "--socket", str(running.socket)],
        stdin=slave, stdout=slave, stderr=slave, env={**environment(), "COLUMNS": "200"},
    )  # fmt: skip
    os.close(slave)
    jog = Jogging(process, master)
    try:
        jog.shows("space STOP")
        yield jog
    finally:
        jog.end()


def commanded(client: Client) -> list[float]:
    return [axis["command_mm"] for axis in client.status()["robots"]["f0"]["axes"].values()]


def test_keys_move_tip_and_axes_and_space_stops() -> None:
    with daemon() as running, running.client() as client:
        armed(client)
        client.move(HERE)
        client.release()
        arrives(client, "f0", (50.0, 75.0, 0.0))
        with jogging(running) as jog:
            jog.shows("tip: 10 mm/s, step 1.5 mm")
            jog.press(b"\x1b[C", 10)
            until(lambda: client.status()["robots"]["f0"]["tip_mm"][0] > 51.0, "the tip went right")
            assert client.status()["robots"]["f0"]["tip_mm"][1] == pytest.approx(75.0, abs=0.5)
            time.sleep(1.0)
            jog.press(b"2")
            jog.shows("axes right_mm: 10 mm/s")
            before = commanded(client)
            jog.press(b"+")
            jog.shows("axes right_mm: 15 mm/s")
            jog.press(b"w", 10)
            until(lambda: commanded(client)[1] > before[1] + 1.0, "the axis moved")
            # Released: it holds, and stays where it is.
            time.sleep(1.0)
            stood = commanded(client)
            assert stood[0] == pytest.approx(before[0], abs=0.01)
            time.sleep(0.3)
            assert commanded(client) == stood
            jog.press(b"w", 3)
            jog.press(b" ")
            jog.shows("STOP. e resumes")
            until(lambda: states(client) == {"OFF"}, "it stopped")  # before that a resume is refused
            stopped = commanded(client)
            jog.press(b"e")
            until(lambda: states(client) == {"HOLD"}, "it is armed again")
            jog.press(b"s", 8)
            until(lambda: commanded(client)[1] < stopped[1] - 0.5, "it moves again")
            until(lambda: states(client) == {"HOLD"}, "it stands")
            stood = commanded(client)
            jog.press(b"\t")
            jog.press(b"\t")
            jog.shows("bends s1: 10 deg/s, step 1.5 deg")
            jog.press(b"w", 5)
            until(lambda: commanded(client)[1] - commanded(client)[0] > stood[1] - stood[0] + 0.2, "it bends")
            assert sum(commanded(client)) == pytest.approx(sum(stood), abs=0.05)
            jog.press(b"q")
            assert jog.process.wait(20) == 0
        assert client.status()["lease"]["holder"] is None


def test_losses_have_a_message_and_the_robot_holds() -> None:
    with daemon() as running, running.client() as client:
        armed(client)
        client.move(HERE)
        with jogging(running) as jog:
            # Not without the lease.
            jog.shows("has held the lease")
            assert jog.process.wait(20) == 2
        with jogging(running, "--takeover") as jog:
            jog.press(b"a", 5)
            client.acquire(takeover=True)
            until(lambda: states(client) == {"HOLD"}, "it holds")
            jog.press(b"a", 3)
            jog.shows("has held the lease")
            assert jog.process.poll() is None
            client.release()
            jog.press(b"d", 20)
            # A program that stands still: no further than one step.
            jog.process.send_signal(signal.SIGSTOP)
            time.sleep(0.5)
            stood = commanded(client)
            time.sleep(0.3)
            assert commanded(client) == stood
            until(lambda: client.status()["lease"]["holder"] is None, "the lease lapsed")
            jog.process.send_signal(signal.SIGCONT)
            running.process.kill()
            jog.press(b"d", 3)
            jog.shows("robots that this client moved hold")
            assert jog.process.wait(20) == 2


def test_mistakes_are_named() -> None:
    with daemon(2) as running, running.client() as client:
        armed(client)
        for arguments, message in (((), "several robots; name one: f0, f1"), (("f7",), "no robot 'f7'")):
            done = subprocess.run(
                [*command("jog", *arguments), "--socket", str(running.socket)],
                capture_output=True, text=True, timeout=60, stdin=subprocess.DEVNULL, check=False,
            )  # fmt: skip
            assert done.returncode == 2
            assert message in done.stderr
