"""Jogging by a gamepad: the deflection of its axes is the speed, while the dead-man button is held."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from contid.client import Client, ServoState
from contid.errors import ContidError
from contid_hands.teleop.gamepad.mapping import BoundInput
from contid_hands.teleop.gamepad.pad import ESTOP, Gamepad
from contid_hands.teleop.jog_session import Console, JogOptions, JogSession, StopPressedError
from contid_hands.teleop.jog_space import Space
from contid_hands.teleop.jogger import Jogger

#: Key of `JogSession` that does what an order of the mapping asks for. The order ``space`` switches between
#: tip and axes, as Tab does; the key "space", the space bar, stops.
_KEY_OF_ORDER: Final = {"resume": "e", "space": "\t", "faster": "+", "slower": "-"}
_STOP_KEY: Final = "space"
#: Refusals are reported no more often than this [s].
REFUSED_PERIOD_S: Final = 1.0


class ReleasedError(ContidError):
    """The dead-man button was released; ends a stream, so that the robot holds at once."""


def apply(jogger: Jogger, pad: Gamepad, inputs: tuple[BoundInput | None, ...], now_s: float) -> None:
    """Press every column of a jogger by the deflection of its input; None is no deflection."""
    for column, bound in enumerate(inputs):
        jogger.press(column, pad.share(bound, now_s), now_s)


class GamepadSession(JogSession):
    """Jogs one robot by a gamepad; keys change and stop, but do not move.

    Every end of a stream is a hold: the robot brakes within its limits instead of going on to the last
    set-point. The next stream begins with the next press of the dead-man button.

    It overrides methods of `JogSession` and uses its attributes: ``_client``, ``_log``, ``space`` (without
    bends; its axis is the first one that is moved), and ``_waiting`` (keys and orders not yet handled).

    Args:
        client: connection to the daemon.
        console: terminal of the operator.
        options: options of `JogSession`; a mapping without the tip begins in axis space.
        pad: the gamepad.

    Raises:
        ContidError: an unknown robot, or none named of several.
    """

    #: A release is seen within a tick of most robots.
    rate_hz = 200.0

    def __init__(self, client: Client, console: Console, options: JogOptions, pad: Gamepad) -> None:
        super().__init__(client, console, replace(options, axes=options.axes or not any(pad.mapping.tip)))
        self.space.spaces = [each for each in self.space.spaces if each is not Space.BENDS]
        self._pad = pad
        self._held = self._estops = False
        self._refused_s = float("-inf")

    def step(self, jogger: Jogger, state: ServoState) -> bool:
        """Carry out what was pressed and the deflections, in one period of a stream.

        Returns:
            True: the stream goes on. Every end of it is an exception, so that the robot holds at once.

        Raises:
            ReleasedError: the dead-man button was released, or the columns change.
            StopPressedError: the stop button was pressed.
            DeviceLostError: the device is gone.
        """
        first = self.space.axis
        goes_on = super().step(jogger, state)
        if not goes_on or not self._held or self.space.axis != first:
            raise ReleasedError("released")
        apply(jogger, self._pad, self._inputs(), time.monotonic())
        return True

    def engaged(self, jogger: Jogger | None) -> bool:
        """True while the dead-man button is held."""
        return self._held

    @property
    def note(self) -> str:
        """What to press next, for the line of state."""
        name = self._pad.mapping.dead_man_name
        if self._held:
            return f", {name} held"
        centred = self._pad.centred(time.monotonic())
        return f", press {name}" if centred else f", centre the sticks, then press {name}"

    def _inputs(self) -> tuple[BoundInput | None, ...]:
        """The input of every column that can be moved now, None for a column without one."""
        mapping, count = self._pad.mapping, len(self.space.columns)
        if self.space.space is Space.TIP:
            return mapping.tip[:count]
        placed = ((None,) * self.space.axis + mapping.axes)[:count]
        return placed + (None,) * (count - len(placed))

    def _direction(self, key: str) -> tuple[int, float] | None:
        """None: no key moves the robot."""
        return None

    def _read(self) -> None:
        """Take in keys, the dead-man button and orders since the last call."""
        super()._read()
        state = self._pad.poll(time.monotonic())
        self._held = state.held
        # A stop comes before whatever else was pressed.
        self._waiting += [_KEY_OF_ORDER.get(order, order) for order in state.orders]
        self._waiting.sort(key=lambda key: key not in (ESTOP, _STOP_KEY))

    def _other(self, key: str, jogger: Jogger | None) -> None:
        """Carry out a key, or one of the two orders that no key has: emergency stop, and the next axes."""
        if key == ESTOP:
            self._estops = True
            if jogger is not None:
                raise StopPressedError(key)
            self._stop()
        elif key == "next_axes":
            following = self.space.axis + len(self._pad.mapping.axes)
            self.space.axis = following if following < len(self.robot.axes) else 0
        else:
            super()._other(key, jogger)

    def _stop(self) -> None:
        """Stop the robot; by its ``estop`` when the stop button was pressed, else as the space bar does."""
        if not self._estops:
            super()._stop()
            return
        self._estops = False
        response = self._order(lambda: self._client.estop(self.robot.robot))
        self._report_stop(f"STOP ({self.robot.estop})", response)

    def refused(self, message: str) -> None:
        """Report a refused set-point: of a stick held outwards, refused in every tick, once a second."""
        if (now_s := time.monotonic()) - self._refused_s > REFUSED_PERIOD_S:
            self._refused_s = now_s
            super().refused(message)

    def _move(self, frame: Mapping[str, Any]) -> None:
        """Run one stream until the dead-man button is released."""
        try:
            super()._move(frame)
        except ReleasedError:
            pass
        finally:
            self._held = False
            self._pad.release()
