"""What trackers share when they hand tips on: the daemon gets them, refusals are named once."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final, Protocol

from contid.client import Client, Code, RemoteError
from contid.targets import Vec3
from contid.units import MM_PER_M

#: A number of a message, but no digit of a name: refusals that differ by it have one reason.
_NUMBER: Final = re.compile(r"(?<!\w)-?\d[\d.]*(?:e[-+]\d+)?")


class SentTip(Protocol):
    """What the daemon gets."""

    @property
    def time_s(self) -> float:
        """Time of the capture."""

    @property
    def tip_m(self) -> Vec3:
        """Tip in the world."""

    @property
    def direction(self) -> Vec3 | None:
        """Of the robot at its tip, in the world; None where it is not measured."""


class TipSender:
    """Sends measured tips; one that the daemon refuses, out of reach or too old, does not end the tracker.

    The first of each robot waits for its answer, the others do not: a daemon that is busy holds no tip up.

    Args:
        client: connected to the daemon.
        notify: gets each reason of a refusal once per robot.
    """

    def __init__(self, client: Client, notify: Callable[[str], None]) -> None:
        self._client, self._notify = client, notify
        self._notified: set[str] = set()
        self._known: set[str | None] = set()

    def send(self, tip: SentTip, robot: str | None) -> None:
        """Send a tip.

        Args:
            tip: of the robot.
            robot: its name; None for the only one of the daemon.

        Raises:
            RemoteError: another client tracks the robot, or there is no such robot.
        """
        tip_mm = [value * MM_PER_M for value in tip.tip_m]
        refused: list[RemoteError] = []
        if robot in self._known:
            refused = self._client.track(tip_mm, tip.time_s, direction=tip.direction, robot=robot)
        else:
            try:
                self._client.measure(tip_mm, direction=tip.direction, robot=robot, time_s=tip.time_s)
            except RemoteError as error:
                refused.append(error)
        for each in refused:
            if each.code != Code.BAD_MEASUREMENT:
                raise each
            reason = _NUMBER.sub("", str(each))
            if reason not in self._notified:
                self._notified.add(reason)
                self._notify(str(each))
        self._known.add(robot)
