"""Jogging a robot of a running daemon by keys: `Client.servo` while it moves, telemetry while it does not."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from contid.cli.support.orders import UNCONFIRMED
from contid.client import Client, Code, RemoteError, ServoState
from contid.errors import ContidError
from contid.remote.client.described_robot import DescribedRobot, columns_of
from contid.remote.client.servo import Controller
from contid.robot_file.findings import allowed_names
from contid_hands.teleop.jog_space import BEGIN, JogSpace, Space
from contid_hands.teleop.jogger import Jogger
from contid_hands.teleop.keys import Keyboard
from contid_hands.teleop.status_line import with_units

#: The lease lapses this long after the last request; between motions there is one every half second.
LEASE_TIMEOUT_S: Final = 2.0
#: Set-points per second, and telemetry while nothing moves.
RATE_HZ: Final = 50.0
#: A stream ends when no key came for this time; the next key begins another.
IDLE_S: Final = 0.5
SHOW_PERIOD_S: Final = 0.1
#: Fields of telemetry from which a jog begins, and which are shown.
FIELDS: Final = ("state", "fault", "tip_mm", "measured", *BEGIN.values())

HELP: Final = (
    "arrows/WASD R/F move, 1-9 axis or section, Tab tip/bends/axes, +/- speed, space STOP, e resume, q quit"
)


class StopPressedError(ContidError):
    """The operator pressed the key that stops."""


@dataclass(frozen=True, slots=True)
class Console:
    """The terminal of an operator.

    Attributes:
        keyboard: where keys come from.
        log: called with a line that stays.
        show: called with the line of the present state.
    """

    keyboard: Keyboard
    log: Callable[[str], None]
    show: Callable[[str], None]


@dataclass(frozen=True, slots=True)
class JogOptions:
    """How a robot is jogged.

    Attributes:
        robot: its name; None for the only one.
        hold_s: how long one key press, or one set-point of a stick, moves.
        speed: first speed of the tip [mm/s]; None: see `TIP_MM_S`.
        axes: begin in axis space.
    """

    robot: str | None = None
    hold_s: float = 0.15
    speed: float | None = None
    axes: bool = False


class JogSession:
    """Jogs one robot.

    Attributes:
        rate_hz: rate of set-points, unless the tick is slower.
        robot: the robot.
        space: what the keys move.

    Args:
        client: connection to the daemon.
        console: terminal of the operator.
        options: robot, hold time, speed, space.

    Raises:
        ContidError: an unknown robot, or none named of several.
    """

    rate_hz = RATE_HZ

    def __init__(self, client: Client, console: Console, options: JogOptions) -> None:
        name = options.robot
        describe = client.describe()
        known = columns_of(describe)
        if name is None and len(known) > 1:
            raise ContidError(f"there are several robots; name one: {', '.join(known)}")
        if name is not None and name not in known:
            raise ContidError(f"no robot {name!r}; {allowed_names(known, name)}")
        self.robot: DescribedRobot = known[name] if name is not None else next(iter(known.values()))
        self._rate_hz = min(self.rate_hz, float(describe["rate_hz"]))
        self._client = client
        self._keyboard = console.keyboard
        self._log = console.log
        self._show = console.show
        self._hold_s = options.hold_s
        self.space = JogSpace(self.robot, options.axes, options.speed)
        self._shown_s = 0.0
        self._waiting: list[str] = []
        self._ended = False

    def run(self, takeover: bool = False) -> None:
        """Until the operator quits or the input ends.

        Raises:
            RemoteError: the lease is held by another client.
            ConnectionLostError: the daemon is gone.
        """
        self._client.acquire(LEASE_TIMEOUT_S, takeover=takeover)
        while (frame := self._idle()) is not None:
            try:
                self._move(frame)
            except StopPressedError:
                self._stop()
            except RemoteError as error:
                resumes = error.code in (Code.STOPPED, Code.NOT_ARMED)
                self._log(f"{error}. e resumes" if resumes else str(error))

    # -- standing ------------------------------------------------------------------------------------------

    def _idle(self) -> Mapping[str, Any] | None:
        """Read keys until one moves; the newest telemetry, None at the end."""
        rate_hz = min(RATE_HZ, self._rate_hz)
        for frame in self._client.telemetry(rate_hz, robots=self.robot.robot, fields=FIELDS):
            state = frame["robots"][self.robot.robot]
            self._display(state, None)
            self._read()
            while self._waiting:
                if self._direction(self._waiting[0]) is not None:
                    return frame
                self._other(self._waiting.pop(0), None)
            if self._ended:
                return None
            if self.engaged(None):
                return frame
        return None

    def _read(self) -> None:
        """Take in what was pressed since the last call."""
        keys = self._keyboard.keys()
        if keys is None:
            self._ended = True
        self._waiting += keys or []

    def _other(self, key: str, jogger: Jogger | None) -> None:
        """A key that does not move."""
        match key:
            case "space" if jogger is not None:
                raise StopPressedError("stop")
            case "space":
                self._stop()
            case "q" | "escape":
                self._ended = True
            case "\t" | "m":
                self.space.go_on()
            case "+" | "=" | "-":
                self.space.change_speed(key == "-", jogger, self._hold_s)
            case "e":
                self._order(lambda: self._client.resume(self.robot.robot, after_stop=True))
            case "h" | "?":
                self._log(HELP)
            case _ if key.isdecimal() and int(key) > 0:  # "²" is a digit, but no number
                self.space.choose(int(key) - 1)

    def _stop(self) -> None:
        self._report_stop("STOP", self._order(lambda: self._client.stop(self.robot.robot)))

    def _report_stop(self, stop: str, response: Mapping[str, Any] | None) -> None:
        """State a stop; None in place of its response: it was refused, which is reported already."""
        name = self.robot.robot
        if response is None:
            return
        self._log(f"{name}: {stop}. e resumes")
        if silent := response.get("silent", {}).get(name):
            self._log(f"{name}: {', '.join(silent)} did not answer and may have missed it: {UNCONFIRMED}")

    def _order(self, send: Callable[[], Mapping[str, Any]]) -> Mapping[str, Any] | None:
        """Give an order and report a refusal; its response, None when it was refused."""
        response = None
        try:
            response = send()
            # A stop of another client revoked the lease: the person at the keys takes it again.
            self._client.acquire(LEASE_TIMEOUT_S)
        except RemoteError as error:
            self._log(str(error))
        return response

    # -- moving --------------------------------------------------------------------------------------------

    def _direction(self, key: str) -> tuple[int, float] | None:
        """Column and sign of a key that moves."""
        return self.space.direction(key)

    def _move(self, frame: Mapping[str, Any]) -> None:
        state = frame["robots"][self.robot.robot]
        start = self.space.begin(state)
        if start is None:
            self._waiting.clear()
            raise RemoteError(Code.NOT_ARMED, f"{self.robot.robot} is {state['state']} and was never armed")
        controller = self._controller(self.space.jogger(start, self._hold_s))
        self._client.servo(self._rate_hz, controller, nearest=self.space.space is not Space.AXES)

    def _controller(self, jogger: Jogger) -> Controller:
        """The controller of one stream: set-points of a jogger until nothing was pressed for a while."""
        columns, pressed_s = self.space.columns, time.monotonic()

        def set_point(state: ServoState) -> dict[str, float] | None:
            nonlocal pressed_s
            if state.refused:
                jogger.refuse()
                self.refused(state.refused)
            elif state.reached:
                sent = zip(columns, jogger.reference, strict=True)
                jogger.take([state.reached.get(column, value) for column, value in sent])
            elif state.step > 0:  # before that none was sent
                jogger.accept()
            goes_on = self.step(jogger, state)
            now_s = time.monotonic()
            if self.engaged(jogger):
                pressed_s = now_s
            if not goes_on or now_s - pressed_s > IDLE_S:
                return None
            return dict(zip(columns, jogger.advance(now_s), strict=True))

        return set_point

    def engaged(self, jogger: Jogger | None) -> bool:
        """The operator moves the robot now; None: while no stream goes on."""
        return jogger is not None and jogger.moving(time.monotonic())

    def step(self, jogger: Jogger, state: ServoState) -> bool:
        """One period of a stream: keys, then the line of state; False ends the stream."""
        now_s = time.monotonic()
        columns = self.space.columns
        self._read()
        waiting, self._waiting = self._waiting, []
        for key in waiting:
            direction = self._direction(key) if self.space.columns == columns else None
            if direction is not None:
                jogger.press(*direction, now_s)
            else:
                self._other(key, jogger)
        self._display(state.robots[self.robot.robot], jogger)
        return not self._ended and self.space.columns == columns

    def _display(self, state: Mapping[str, Any], jogger: Jogger | None) -> None:
        if time.monotonic() - self._shown_s < SHOW_PERIOD_S:
            return
        self._shown_s = time.monotonic()
        tip = " ".join(f"{value:.1f}" for value in state["tip_mm"] or ())
        measured = state["measured"]
        axes = with_units(measured, self.robot.units) if measured else "not measured"
        fault = f" fault {state['fault']}" if state["fault"] else ""
        self._show(
            f"{self.robot.robot} {state['state']}{fault} | {self.space.label(self._hold_s)}{self.note} | "
            f"tip {tip} mm | axes {axes}"
        )

    @property
    def note(self) -> str:
        """Part of the line of state."""
        return ""

    def refused(self, message: str) -> None:
        """Report a refused set-point."""
        self._log(f"refused: {message}")
