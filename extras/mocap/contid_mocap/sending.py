"""Sends measured tips to the daemon."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from contid.client import Client, Code, RemoteError
from contid.units import MM_PER_M
from contid_mocap.tip_tracker import RoomTip


class TipSender:
    """Sends the newest tip of each robot; what the daemon refuses does not end the tracker.

    Args:
        client: connected to the daemon.
        notify: gets each reason of a refusal once.
    """

    def __init__(self, client: Client, notify: Callable[[str], None]) -> None:
        self._client, self._notify = client, notify
        self._printed: set[str] = set()

    def __call__(self, tips: Sequence[RoomTip]) -> None:
        """Send the tips of one look.

        Raises:
            RemoteError: another client tracks the robot, or there is no such robot.
        """
        # A tick takes the newest pose; older ones of the same look would only cost time.
        for tip in {tip.robot: tip for tip in tips}.values():
            tip_mm = [value * MM_PER_M for value in tip.tip_m]
            try:
                self._client.measure(tip_mm, direction=tip.direction, robot=tip.robot, time_s=tip.time_s)
            except RemoteError as error:
                if error.code != Code.BAD_MEASUREMENT:
                    raise
                kind = re.sub(r"[-\d.]+", "", str(error))
                if kind not in self._printed:
                    self._printed.add(kind)
                    self._notify(str(error))
