"""A gamepad at a real daemon: release and unplugging hold, stop stops, nothing goes on by itself."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from contid.client import Client
from contid.errors import ContidError, DeviceLostError
from contid_hands.teleop.gamepad.mapping import default_mapping, read_mapping
from contid_hands.teleop.gamepad.pad import Gamepad
from contid_hands.teleop.gamepad.session import GamepadSession
from contid_hands.teleop.jog_session import Console, JogOptions
from contid_hands.teleop.keys import Keyboard
from tests.support.daemons import HERE, Running, armed, daemon, states
from tests.support.pads import (
    ABS_RX,
    ABS_X,
    ABS_Y,
    BTN_EAST,
    BTN_SELECT,
    BTN_START,
    BTN_TL,
    Recording,
    recorded,
)
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]


class Operator:
    """A session in a thread, its device and its keys."""

    def __init__(self, running: Running, recording: Recording, pad: Gamepad) -> None:
        self.pad = recording
        self.lines: list[str] = []
        self.shown = ""
        self.error: ContidError | None = None
        self._keys, self._writer = os.pipe()
        self._thread = threading.Thread(target=self._run, args=(running, pad))
        self._thread.start()

    def _run(self, running: Running, pad: Gamepad) -> None:
        try:
            with running.client() as client, Keyboard(self._keys) as keyboard:
                console = Console(keyboard, self.lines.append, self._show)
                GamepadSession(client, console, JogOptions(speed=20.0), pad).run()
        except ContidError as error:
            self.error = error

    def _show(self, line: str) -> None:
        self.shown = line

    def key(self, keys: bytes) -> None:
        os.write(self._writer, keys)

    def shows(self, text: str) -> None:
        until(lambda: text in self.shown, f"it shows {text!r}")

    def ended(self) -> bool:
        return not self._thread.is_alive()

    def end(self) -> None:
        os.close(self._writer)
        self._thread.join(30.0)
        os.close(self._keys)


@contextmanager
def operated() -> Iterator[tuple[Client, Operator]]:
    """A robot within reach of both directions, its operator, and another client."""
    with daemon() as running, running.client() as client:
        armed(client)
        client.move(HERE)
        client.release()
        with recorded() as (recording, device):
            pad = Gamepad(device, read_mapping(default_mapping("gamepad"), device.has))
            operator = Operator(running, recording, pad)
            try:
                operator.shows("press BTN_TL")
                yield client, operator
            finally:
                operator.end()
        until(lambda: client.status()["lease"]["holder"] is None, "its lease has ended")


def commanded(client: Client) -> list[float]:
    return [axis["command_mm"] for axis in client.status()["robots"]["f0"]["axes"].values()]


def stands(client: Client) -> list[float]:
    until(lambda: states(client) == {"HOLD"}, "it holds")
    time.sleep(0.4)
    stood = commanded(client)
    time.sleep(0.3)
    assert commanded(client) == stood
    return stood


def test_release_holds_and_stop_stops() -> None:
    with operated() as (client, operator):
        begin = stands(client)
        operator.pad.axis(ABS_X, 32767)
        operator.shows("centre the sticks, then press BTN_TL")
        operator.pad.button(BTN_TL, 1)
        operator.key(b"d")  # keys do not move
        assert stands(client) == begin
        operator.pad.axis(ABS_X, 0)
        operator.pad.button(BTN_TL, 0)
        operator.pad.button(BTN_TL, 1)
        operator.shows("BTN_TL held")
        operator.pad.axis(ABS_X, 32767)
        until(lambda: client.status()["robots"]["f0"]["tip_mm"][0] > 52.0, "the tip went right")
        operator.pad.button(BTN_TL, 0)
        stands(client)
        # Axes: the mode changes without a motion, the second stick moves the second half of the axes.
        operator.pad.axis(ABS_X, 0)
        operator.pad.button(BTN_SELECT, 1)
        operator.shows("axes")
        before = stands(client)
        operator.pad.button(BTN_TL, 1)
        operator.shows("BTN_TL held")
        operator.pad.axis(ABS_Y, 32767)
        until(lambda: commanded(client)[1] < before[1] - 2.0, "the second axis went back")
        assert commanded(client)[0] == pytest.approx(before[0], abs=0.01)
        # A stop in a motion; resumed, the held button and the deflected stick move nothing.
        operator.pad.button(BTN_EAST, 1)
        until(lambda: "f0: STOP (relax). e resumes" in operator.lines, "the stop is shown")
        until(lambda: states(client) == {"OFF"}, "it stopped")
        operator.pad.button(BTN_START, 1)
        stands(client)
        operator.pad.axis(ABS_RX, 32767)
        stands(client)
        operator.key(b"q")
        until(operator.ended, "it ended")
        assert operator.error is None


def test_an_unplugged_pad_holds_and_ends() -> None:
    with operated() as (client, operator):
        operator.pad.button(BTN_TL, 1)
        operator.shows("BTN_TL held")
        operator.pad.axis(ABS_X, -32768)
        until(lambda: client.status()["robots"]["f0"]["tip_mm"][0] < 49.0, "the tip went left")
        operator.pad.unplug()
        until(operator.ended, "it ended")
        assert isinstance(operator.error, DeviceLostError)
        assert operator.error.exit_code == 4
        stands(client)
