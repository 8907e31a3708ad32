"""Sends the tips of a room to the daemon."""

from __future__ import annotations

from collections.abc import Sequence

from contid_camera.sending import TipSender
from contid_mocap.tip_tracker import RoomTip


class RoomTipSender(TipSender):
    """Sends the newest tip of each robot."""

    def __call__(self, tips: Sequence[RoomTip]) -> None:
        """Send the tips of one look; raises as `send`."""
        # A tick takes the newest pose; older ones of the same look would only cost time.
        for tip in {tip.robot: tip for tip in tips}.values():
            self.send(tip, tip.robot)
