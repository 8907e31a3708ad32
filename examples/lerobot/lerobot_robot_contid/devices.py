"""A robot whose actions are columns of axes, and a leader whose measured axes are the actions."""

from __future__ import annotations

import logging
import math
import threading
from typing import Any

from lerobot.robots import Robot
from lerobot.teleoperators import Teleoperator
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from contid.client import Client, ServoState
from lerobot_robot_contid.config import ContidLeaderConfig, ContidRobotConfig


def _columns(robots: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The axes of all robots by their columns, of ``describe`` or ``status``."""
    found = {}
    for name, robot in robots.items():
        for axis, values in robot.get("axes", {}).items():
            unit = next(key for key in values if key.startswith("min_")).removeprefix("min_")
            found[f"{name}." * (len(robots) > 1) + f"{axis}_{unit}"] = values
    return found


def _value(column: str, axis: dict[str, Any], key: str) -> float:
    value = axis.get(f"{key}_{column.rpartition('_')[2]}")
    return math.nan if value is None else float(value)


class _Reader:
    """Axes and tips of all robots of a daemon, without a lease."""

    def __init__(self, socket: str | None) -> None:
        self._client = Client(socket, name="lerobot")
        axes = _columns(self._client.describe()["robots"])
        self.limits = {
            name: (_value(name, axis, "min"), _value(name, axis, "max")) for name, axis in axes.items()
        }
        self._last = dict.fromkeys(self.limits, math.nan)

    def axes(self, key: str = "measured") -> dict[str, float]:
        """A value of every axis in its unit; of a device that is silent the last one."""
        self._robots = self._client.status()["robots"]
        found = {name: _value(name, axis, key) for name, axis in _columns(self._robots).items()}
        self._last |= {name: value for name, value in found.items() if math.isfinite(value)}
        return dict(self._last)

    def observation(self) -> dict[str, float]:
        """Measured axes, and tips [mm] by forward kinematics."""
        found = self.axes()
        for robot, state in self._robots.items():
            prefix = f"{robot}." * (len(self._robots) > 1)
            for axis, value in zip("xyz", state.get("tip_mm") or (math.nan,) * 3, strict=True):
                found[f"{prefix}tip_{axis}_mm"] = float(value)
        return found

    def close(self) -> None:
        """End the connection."""
        self._client.close()


class _Device:
    """What both kinds have in common: no calibration of LeRobot's kind, and a reader of the daemon."""

    config: ContidRobotConfig | ContidLeaderConfig
    is_calibrated = True  # by `contid home` and the robot file
    _found: _Reader | None = None

    @property
    def _reader(self) -> _Reader:
        if self._found is None:
            self._found = _Reader(self.config.socket)
        return self._found

    def _forget(self) -> None:
        if self._found is not None:
            self._found.close()
        self._found = None

    def _connected(self, yes: bool) -> None:
        if self.is_connected is not yes:
            raise (DeviceNotConnectedError if yes else DeviceAlreadyConnectedError)(f"{self}: contid")

    @property
    def action_features(self) -> dict[str, type]:
        return dict.fromkeys(self._reader.limits, float)

    def calibrate(self) -> None: ...

    def configure(self) -> None: ...


class ContidRobot(_Device, Robot):
    """Robots that follow actions, within the limits and rates of the daemon and under its supervisor.

    A thread sends the newest action at a rate of its own, as a row of a live stream: when LeRobot's loop is
    late the robots hold at the last action, and when its process hangs the lease lapses and they hold.
    """

    config_class = ContidRobotConfig
    name = "contid"
    cameras: dict[str, Any] = {}  # noqa: RUF012 - lerobot-record of 0.4 counts them, and contid has none
    _thread: threading.Thread | None = None

    def __init__(self, config: ContidRobotConfig) -> None:
        super().__init__(config)
        self.config = config

    @property
    def observation_features(self) -> dict[str, type]:
        return dict.fromkeys(self._reader.observation(), float)

    @property
    def is_connected(self) -> bool:
        return self._thread is not None

    def connect(self, calibrate: bool = True) -> None:
        """Take the lease, arm the robots and hold them where they are."""
        self._connected(False)
        self._error: Exception | None = None
        self._end, self._refused = threading.Event(), ""
        client = Client(self.config.socket, name="lerobot robot")
        client.resume()
        self._row = self._reader.axes("command")
        self._thread = threading.Thread(target=self._drive, args=(client,), name="contid", daemon=True)
        self._thread.start()

    def get_observation(self) -> dict[str, Any]:
        """Measured axes in their units, and tips."""
        self._connected(True)
        return self._reader.observation()

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Follow an action; returns it within limits, and with the last value where not finite.

        Raises:
            DeviceNotConnectedError: the stream ended, with the daemon's reason (a stop, a fault).
        """
        self._connected(True)
        if self._error is not None:
            raise DeviceNotConnectedError(str(self._error)) from self._error
        row = dict(self._row)
        for name, (low, high) in self._reader.limits.items():
            value = float(action[name])
            if math.isfinite(value):
                row[name] = min(max(value, low), high)
        self._row = row
        return dict(row)

    def disconnect(self) -> None:
        """Settle on the last action, and hold there; the daemon goes on running."""
        self._connected(True)
        self._end.set()
        assert self._thread is not None
        self._thread.join()
        self._thread = None
        self._forget()

    def _drive(self, client: Client) -> None:
        try:
            with client:
                client.servo(self.config.rate_hz, self._next)
        except Exception as error:  # of this thread; the next action raises it
            self._error = error

    def _next(self, state: ServoState) -> dict[str, float] | None:
        if state.refused and state.refused != self._refused:
            logging.warning("contid refuses an action, and holds: %s", state.refused)
        self._refused = state.refused
        return None if self._end.is_set() else self._row


class ContidLeader(_Device, Teleoperator):
    """Robots whose measured axes are the actions; they are moved by hand or by `contid move`."""

    config_class = ContidLeaderConfig
    name = "contid"
    feedback_features: dict[str, type] = {}  # noqa: RUF012 - LeRobot's attribute
    is_connected = False

    def __init__(self, config: ContidLeaderConfig) -> None:
        super().__init__(config)
        self.config = config

    def connect(self, calibrate: bool = True) -> None:
        """Look at the daemon for the first time."""
        self._connected(False)
        self.is_connected = bool(self._reader.limits)

    def get_action(self) -> dict[str, Any]:
        """Measured axes in their units."""
        self._connected(True)
        return self._reader.axes()

    def send_feedback(self, feedback: dict[str, Any]) -> None: ...

    def disconnect(self) -> None:
        """End."""
        self._connected(True)
        self.is_connected = False
        self._forget()
