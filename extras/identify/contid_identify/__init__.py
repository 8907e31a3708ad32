"""The robot in motion from its own recordings: delay and lag, swing, body; motions that show them."""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "identify": ("contid_identify.command", "delay, lag and swing of a robot, from its recordings"),
    "predict": ("contid_identify.predict_command", "a recording beside what the identified robot would do"),
    "excite": ("contid_identify.excite_command", "a trajectory that shows how a robot moves"),
}
