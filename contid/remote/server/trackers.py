"""Tip measurements of clients: checked, one tracker per robot, at most one per tick.

A measurement needs no lease, but with ``feedback`` it moves the target, so it is bounded here and in
`contid.control.tick.tip_feedback`: the first client to measure a robot tracks it until it has been silent for
`SILENT_S` or disconnects; a tip must lie within the robot's reach; old measurements are refused; only the
newest one crosses the pipe, once per new record. A stopped control process gets none, so nothing piles up.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from contid.control.daemon.interfaces import RunControl
from contid.control.engine.messages import Measured
from contid.control.process.isolation.model_threads import ModelThreads
from contid.control.tick.config import RobotConfig
from contid.remote.protocol.wire import Code, Fields, RemoteError, RequestFields, is_number
from contid.remote.server.telemetry_view import TelemetryView
from contid.targets import Vec3, unit_vector
from contid.units import MM_PER_M

#: After so long without a measurement another client may track the robot.
SILENT_S: Final = 1.0
#: Maximum age for a robot without feedback; with feedback it is the file's ``stale_ms``.
STALE_S: Final = 0.2
#: Tolerance for stamps ahead of this clock: rounding.
AHEAD_S: Final = 2e-3
#: A tip further from the base than this multiple of the longest backbone is in another unit or frame.
REACH: Final = 1.5
POINTS: Final = 65
#: Maximum of a number; whole numbers of JSON may exceed the range of a float.
MAX_NUMBER: Final = 1e15
_MS_PER_S: Final = 1e3
_CLOCK: Final = "; time_s is CLOCK_MONOTONIC of this machine (Python's time.monotonic())"


@dataclass(slots=True)
class Tracker:
    """The client that tracks one robot.

    Attributes:
        client: its number.
        name: its name in messages.
        since_s, seen_s: times of its first and its newest measurement.
        captured_s: time of capture of the newest one, on CLOCK_MONOTONIC.
        pending: the newest one, until it is sent.
        sent_tick: newest tick when the previous one was sent.
        count: measurements accepted.
    """

    client: int
    name: str
    since_s: float
    seen_s: float
    captured_s: float = -math.inf
    pending: Measured | None = None
    sent_tick: int = -1
    count: int = 0


class Trackers:
    """The trackers of one daemon."""

    def __init__(self, control: RunControl, view: TelemetryView) -> None:
        self._control = control
        self._view = view
        self._trackers: dict[str, Tracker] = {}
        self._threads = ModelThreads(control.loaded)
        self._reach_m: dict[str, float] = {}

    @property
    def active(self) -> bool:
        """True while a measurement may wait to be sent."""
        return bool(self._trackers)

    async def measure(self, client: int, name: str, request: RequestFields) -> Fields:
        """Take one measurement.

        Raises:
            RemoteError: malformed, too old, too far, or another client tracks this robot.
        """
        config = self._config(request)
        if config.name not in self._reach_m:
            self._reach_m[config.name] = REACH * await self._threads.call((config.name,), _longest, config)
        now_s = time.monotonic()
        dimension = self._view.robots[config.name].dimension
        tip_mm = _vector(request.anything("tip_mm"), "tip_mm", dimension)
        given, direction = request.anything("direction"), None
        if given is not None:
            direction = unit_vector(_vector(given, "direction", dimension))
            if direction is None:
                raise _bad("direction must not be the zero vector")
        captured_s = self._captured(request, now_s, config)
        request.end()
        tip_in_world: Vec3 = (tip_mm[0] / MM_PER_M, tip_mm[1] / MM_PER_M, tip_mm[2] / MM_PER_M)
        self._check_reach(config, tip_in_world)
        tracker = self._tracker(config.name, client, name, now_s)
        tracker.seen_s, tracker.count = now_s, tracker.count + 1
        used = captured_s > tracker.captured_s
        if used:
            tracker.captured_s = captured_s
            tracker.pending = Measured(config.name, tip_in_world, direction)
            self._send(tracker, now_s)
        return {
            "robot": config.name,
            "age_ms": round((now_s - captured_s) * _MS_PER_S, 3),
            "used": used,
            "feedback": config.feedback is not None,
        }

    def watch(self, now_s: float) -> None:
        """Send pending measurements, remove silent trackers; called periodically."""
        for robot, tracker in tuple(self._trackers.items()):
            if now_s - tracker.seen_s > SILENT_S:
                del self._trackers[robot]
            else:
                self._send(tracker, now_s)

    def disconnected(self, client: int) -> None:
        """A client disconnected; another one may track its robots at once."""
        self._trackers = {robot: each for robot, each in self._trackers.items() if each.client != client}

    def as_fields(self, now_s: float) -> Fields:
        """The field ``trackers`` of ``status``."""
        return {
            robot: {
                "client": tracker.client,
                "name": tracker.name,
                "age_ms": round((now_s - tracker.captured_s) * _MS_PER_S, 3),
                "rate_hz": _rate(tracker),
                "feedback": self._view.configs[robot].feedback is not None,
            }
            for robot, tracker in self._trackers.items()
        }

    # -- inside ------------------------------------------------------------------------------------------

    def _send(self, tracker: Tracker, now_s: float) -> None:
        """Send the pending measurement, once per completed tick."""
        record = self._control.newest()
        if tracker.pending is None or record is None or record.tick == tracker.sent_tick:
            return
        pending, tracker.pending, tracker.sent_tick = tracker.pending, None, record.tick
        age_s = max(now_s - tracker.captured_s, 0.0)
        self._control.send(Measured(pending.robot, pending.tip_in_world, pending.direction_in_world, age_s))

    def _config(self, request: RequestFields) -> RobotConfig:
        configs = self._view.configs
        name = request.text("robot", next(iter(configs)) if len(configs) == 1 else "")
        if not name:
            raise RemoteError(Code.BAD_REQUEST, f"robot: one of {', '.join(configs)} is expected")
        self._view.check((name,))
        return configs[name]

    def _captured(self, request: RequestFields, now_s: float, config: RobotConfig) -> float:
        """Time of capture on CLOCK_MONOTONIC: by a stamp, by an age, or now."""
        stamp, age_ms = request.anything("time_s"), request.anything("age_ms")
        if stamp is not None and age_ms is not None:
            raise RemoteError(Code.BAD_REQUEST, "time_s or age_ms, one of them")
        captured_s = now_s
        if stamp is not None:
            captured_s = _number(stamp, "time_s")
        elif age_ms is not None:
            captured_s = now_s - _number(age_ms, "age_ms") / _MS_PER_S
        max_age_s = config.feedback.stale_s if config.feedback is not None else STALE_S
        age_s = now_s - captured_s
        if age_s > max_age_s:
            message = f"{age_s * _MS_PER_S:.6g} ms old; at most {max_age_s * _MS_PER_S:g} ms are of use"
            raise _bad(f"{config.name}: {message}{_CLOCK if stamp is not None else ''}")
        if age_s < -AHEAD_S:
            raise _bad(f"{config.name}: captured {-age_s * _MS_PER_S:.6g} ms from now{_CLOCK}")
        return min(captured_s, now_s)

    def _check_reach(self, config: RobotConfig, tip_in_world: Vec3) -> None:
        distance_m = math.hypot(*config.frame.point_in_base(tip_in_world))
        if distance_m > self._reach_m[config.name]:
            reach_mm = self._reach_m[config.name] * MM_PER_M
            message = f"a tip {distance_m * MM_PER_M:.6g} mm from the base is not this robot's"
            raise _bad(
                f"{config.name}: {message} (at most {reach_mm:.4g} mm); tip_mm is in mm, in the world frame"
            )

    def _tracker(self, robot: str, client: int, name: str, now_s: float) -> Tracker:
        tracker = self._trackers.get(robot)
        if tracker is not None and tracker.client != client:
            if now_s - tracker.seen_s <= SILENT_S:
                held_s = now_s - tracker.since_s
                message = f"client {tracker.name!r} has tracked {robot} for {held_s:.1f} s"
                raise RemoteError(Code.TRACKER_HELD, f"{message}; one tracker per robot")
            tracker = None
        if tracker is None:
            tracker = self._trackers[robot] = Tracker(client, name, now_s, now_s)
        return tracker


def _longest(config: RobotConfig) -> float:
    """Length of the longest backbone [m]: at rest, or with every axis at its maximum."""
    lines = [config.model.shape(actuation, POINTS) for actuation in (config.rest, config.model.upper)]
    return max(float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in lines)


def _rate(tracker: Tracker) -> float | None:
    """Mean rate of measurements [Hz]."""
    seconds = tracker.seen_s - tracker.since_s
    return round((tracker.count - 1) / seconds, 1) if seconds > 0.0 else None


def _bad(message: str) -> RemoteError:
    return RemoteError(Code.BAD_MEASUREMENT, message)


def _number(value: Any, name: str) -> float:
    if is_number(value) and abs(value) <= MAX_NUMBER:
        return float(value)
    raise _bad(f"{name}: a finite number is expected, got {repr(value)[:60]}")


def _vector(value: Any, name: str, dimension: int) -> Vec3:
    """Three numbers; a planar robot needs two and ignores the third."""
    if not isinstance(value, list) or not dimension <= len(value) <= 3:
        expected = "three numbers" if dimension == 3 else "two or three numbers"
        raise _bad(f"{name}: a list of {expected} is expected, got {repr(value)[:60]}")
    x, y, *rest = [_number(each, f"{name}[{index}]") for index, each in enumerate(value)]
    return (x, y, rest[0] if dimension == 3 else 0.0)
