"""Follows the frames of a room: measures, hands tips on, counts what became of the frames."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from contid.units import MM_PER_M
from contid_camera.refusals import Refusals
from contid_mocap.room import RoomStream
from contid_mocap.tip_tracker import RoomTip, RoomTipTracker

#: A look waits for a frame at most this long [s].
LOOK_S: Final = 0.1
#: Without a tip for this time the reason is printed [s].
SILENT_S: Final = 3.0
HEADER: Final = "t_s,robot,x_mm,y_mm,z_mm,ax,ay,az"


@dataclass(slots=True)
class FollowReport:
    """What became of the poses.

    Attributes:
        looked: poses of the tracked robots in the frames that arrived.
        measured: tips among them that were handed on.
        overtaken: tips that a newer one replaced before they could be handed on.
        missing: frames that did not arrive, summed over the robots.
        refusals: why the other poses gave no tip.
        latency_s: from the capture until a tip is handed on, of the newest 100 000 tips.
        facts: of the stream, one line each.
    """

    looked: int = 0
    measured: int = 0
    overtaken: int = 0
    missing: int = 0
    refusals: Refusals = field(default_factory=Refusals)
    latency_s: deque[float] = field(default_factory=lambda: deque(maxlen=100_000))
    facts: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        """One line, one for each reason, and those of the stream."""
        lines = [f"{self.measured} of {self.looked} poses measured; {self.missing} frames did not arrive"]
        if self.overtaken:
            lines.append(f"{self.overtaken} tips were overtaken by newer ones before they could be sent")
        lines += self.refusals.lines()
        if self.latency_s:
            ordered = sorted(self.latency_s)
            middle_s, high_s = (ordered[int(share * (len(ordered) - 1))] for share in (0.5, 0.99))
            lines.append(f"capture to measure [ms]: p50 {1e3 * middle_s:.2f}, p99 {1e3 * high_s:.2f}")
        return "\n".join([*lines, *self.facts])


@dataclass(frozen=True, slots=True)
class Follower:
    """Hands measured tips on.

    Attributes:
        taken: gets the tips of one look, in the order of their frames.
        notify: gets a line for the user.
        newest: it gets the newest tip of each robot only, as a tick takes no other.
    """

    taken: Callable[[Sequence[RoomTip]], None]
    notify: Callable[[str], None]
    newest: bool = False


def follow(
    stream: RoomStream,
    tracker: RoomTipTracker,
    follower: Follower,
    report: FollowReport,
    seconds: float | None = None,
) -> None:
    """Measure until the time is over; an interrupt ends it as an exception.

    Args:
        stream: frames of the room.
        tracker: of the tips.
        follower: gets tips and lines.
        report: is filled, also when an error ends the loop.
        seconds: None for no end.
    """
    begun_s = fresh_s = time.monotonic()
    refusal, frames = "", 0  # since the newest tip, or the newest notice
    try:
        while seconds is None or time.monotonic() - begun_s < seconds:
            tips = []
            for frame in stream.poll(LOOK_S):
                frames += 1
                looks = tracker.look(frame, time.monotonic())
                for look in looks:
                    report.looked += 1
                    report.missing += look.missing
                    if look.tip is None:
                        refusal = look.refusal
                        report.refusals.add(look.refusal)
                    else:
                        tips.append(look.tip)
                if any(look.restarted for look in looks):
                    stream.restart()
            now_s = time.monotonic()
            if follower.newest:
                found, tips = len(tips), list({tip.robot: tip for tip in tips}.values())
                report.overtaken += found - len(tips)
            if tips:
                report.latency_s.extend(now_s - tip.time_s for tip in tips)
                follower.taken(tips)
                fresh_s, refusal, frames = time.monotonic(), "", 0
                report.measured += len(tips)
            elif now_s - fresh_s >= SILENT_S:
                follower.notify(f"no tip for {SILENT_S:g} s: {refusal or _unseen(stream, tracker, frames)}")
                fresh_s, refusal, frames = now_s, "", 0
    finally:
        report.facts = stream.facts()


def row(tip: RoomTip) -> str:
    """A row under `HEADER`; the direction of a marker is empty."""
    tip_mm = ",".join(f"{value * MM_PER_M:.4f}" for value in tip.tip_m)
    direction = ",,," if tip.direction is None else "".join(f",{value:.6f}" for value in tip.direction)
    return f"{tip.time_s:.6f},{tip.robot},{tip_mm}{direction}"


def _unseen(stream: RoomStream, tracker: RoomTipTracker, frames: int) -> str:
    """Why nothing comes, where none of so many frames had a tracked name."""
    if not frames:
        return "no frame arrives"
    among = ", ".join(stream.names()[:20]) or "what arrives"
    return f"no {', '.join(map(repr, tracker.names))} among {among}"
