"""Sends the tips of a room to the daemon."""

from __future__ import annotations

from collections.abc import Sequence

from contid_camera.sending import TipSender
from contid_mocap.tip_tracker import RoomTip


class RoomTipSender(TipSender):
    """Sends the tips of a room."""

    def __call__(self, tips: Sequence[RoomTip]) -> None:
        """Send the tips of one look, of which a robot has one; raises as `send`."""
        for tip in tips:
            self.send(tip, tip.robot)
