"""A camera as a tracker of tips: calibration, tags, poses that are worth sending."""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "track": ("contid_camera.command", "measure a tip with a camera and tags"),
    "calibrate camera": (
        "contid_camera.calibrate_command",
        "the camera of `contid track`, from pictures of a chessboard",
    ),
}
