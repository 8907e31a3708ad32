"""What both clients share: lines to answers and notices, and the request behind every method."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, Final

from contid.remote.protocol import PROTOCOL, Code, ConnectionLostError, Fields, RemoteError, decode

#: Frames and events that wait for whoever iterates; older ones are dropped and counted.
MAX_WAITING: Final = 4096
#: Seconds to wait for an answer; a daemon that is silent for longer is not there.
ANSWER_S: Final = 10.0
#: Requests that are worked on for longer: a trajectory of 50 000 rows is checked row by row.
PATIENCE_S: Final = {"end": 120.0}
#: How often a client that only waits shows that it is alive: well within the motion right's two seconds.
ALIVE_S: Final = 0.5


class Notices:
    """What came unasked, sorted by what it is about.

    Attributes:
        frames: telemetry and events, in their order.
        ended: how moves ended, by number.
        credits: rows that may still be sent, by number of the move.
        lost_right: why the motion right was lost, "" while it was not.
        farewell: the last words of the daemon.
        dropped: frames that nobody fetched in time, on this side.
    """

    def __init__(self) -> None:
        self.frames: deque[Fields] = deque()
        self.ended: dict[int, Fields] = {}
        self.credits: dict[int, int] = {}
        self.lost_right = ""
        self.farewell = ""
        self.dropped = 0

    def take(self, fields: Fields) -> None:
        """Sort one notice."""
        match fields.get("event"):
            case "telemetry" | "event":
                if len(self.frames) >= MAX_WAITING:
                    self.frames.popleft()
                    self.dropped += 1
                self.frames.append(fields)
            case "move":
                self.ended[int(fields["move"])] = fields
            case "credit":
                self.credits[int(fields["move"])] = int(fields["credits"])
            case "right":
                self.lost_right = str(fields["lost"])
            case "bye":
                self.farewell = str(fields["words"])

    def gone(self, words: str) -> ConnectionLostError:
        """The error of a connection that ended."""
        return ConnectionLostError(f"{self.farewell or words}; robots that this client moved hold")

    def check_arrival(self, move: int) -> bool:
        """True when a move ended well, False while it goes on.

        Raises:
            RemoteError: it ended before its end.
        """
        if move not in self.ended:
            return False
        told = self.ended.pop(move)
        if not told["reached"]:
            faults = told.get("faults")
            words = str(told["words"]) or "the move ended before its target"
            raise RemoteError(Code.FAULT if faults else Code.STOPPED, words, faults)
        return True


def parse(line: bytes, notices: Notices) -> Fields | None:
    """An answer, or None for a notice, which is sorted."""
    fields = decode(line)
    if "event" in fields:
        if fields["event"] == "hello" and fields.get("protocol") != PROTOCOL:
            told, mine = fields.get("protocol"), PROTOCOL
            words = f"the daemon speaks protocol {told}, this client {mine}; update the older one"
            raise RemoteError(Code.PROTOCOL, words)
        notices.take(fields)
        return None
    return fields


def result_of(answer: Mapping[str, Any]) -> Fields:
    """The result of an answer.

    Raises:
        RemoteError: the daemon refused.
    """
    if answer.get("ok"):
        result: Fields = answer["result"]
        return result
    raise RemoteError.of(answer.get("error", {}))


def without_none(fields: Mapping[str, Any]) -> Fields:
    """Only what is given."""
    return {key: value for key, value in fields.items() if value is not None}


def list_of(robots: str | tuple[str, ...] | list[str] | None) -> list[str] | None:
    """One robot, several, or None for all of them."""
    if robots is None:
        return None
    return [robots] if isinstance(robots, str) else list(robots)


def measurement(
    tip_mm: Sequence[float],
    direction: Sequence[float] | None,
    robot: str | None,
    age_ms: float | None,
    time_s: float | None,
) -> Fields:
    """The fields of a measurement; numbers of NumPy become Python's own."""
    return {
        "robot": robot,
        "tip_mm": [float(value) for value in tip_mm],
        "direction": None if direction is None else [float(value) for value in direction],
        "age_ms": None if age_ms is None else float(age_ms),
        "time_s": None if time_s is None else float(time_s),
    }
