"""Motion-capture rooms as trackers of tips: NatNet and Vicon over UDP."""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "track natnet": ("contid_mocap.natnet_command", "bodies and markers of an OptiTrack room"),
    "track vicon": ("contid_mocap.vicon_command", "objects of a Vicon room"),
    "track emulate": ("contid_mocap.emulate.command", "an emulated room, for trials without one"),
}
