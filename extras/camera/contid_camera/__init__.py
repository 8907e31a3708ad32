"""A camera as a tracker of tips: calibration, tags, poses that are worth sending."""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "track": ("contid_camera.track_group", "measure a tip with a camera and tags, or a motion-capture room"),
    "track camera": ("contid_camera.command", "a camera and printed tags; also without the word camera"),
    "calibrate camera": (
        "contid_camera.calibrate_command",
        "the camera of `contid track`, from pictures of a chessboard",
    ),
}
