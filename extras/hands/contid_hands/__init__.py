"""Robots moved by a person: jogging by keys and input devices, poses and motions that are taught."""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "jog": ("contid_hands.commands.jog", "move a robot of a running daemon by keys"),
    "teach": (
        "contid_hands.commands.teach",
        "torque off: save poses and motions of robots moved by hand",
    ),
    "play": ("contid_hands.commands.play", "play a sequence of named poses, with times, waits and loops"),
}
