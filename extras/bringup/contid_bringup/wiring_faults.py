"""Names of what is wrong with a motor or a servo, what each means, and what to do."""

from __future__ import annotations

import enum
from typing import Final


class WiringFault(enum.StrEnum):
    """Name of what is wrong with the wiring of a motor, its encoder or its bridge."""

    NONE = "ok"
    FAULT_LINE = "fault-line"
    BRIDGE_TRIPS = "bridge-trips"
    UNDRIVEN = "moves-without-drive"
    EDGES_MISSED = "edges-missed"
    TRACKS_TOGETHER = "tracks-together"
    TRACK_A = "dead-track-a"
    TRACK_B = "dead-track-b"
    CROSSED_TRACK = "crossed-track"
    CROSSED_AXES = "crossed-axes"
    REVERSED = "reversed"
    ONE_DIRECTION = "one-direction"
    SAME_DIRECTION = "same-direction"
    NO_CURRENT = "no-current"
    DEAD_ENCODER = "dead-encoder"
    NO_MOTION = "does-not-move"
    NO_COUNT = "no-count"
    OTHER_TURNED = "other-part"
    WRONG_SENSE = "wrong-sense"


#: What each name means, and what to do.
MEANINGS: Final[dict[WiringFault, tuple[str, str]]] = {
    WiringFault.NONE: ("motor and encoder are connected and count the right way", ""),
    WiringFault.FAULT_LINE: (
        "the driver of the motor reports a fault at rest",
        "check its supply, its fault line and its pull-up; nothing was driven",
    ),
    WiringFault.BRIDGE_TRIPS: (
        "the driver of the motor reports a fault as soon as it drives",
        "look for a short of the motor's wires, and whether the supply is strong enough",
    ),
    WiringFault.UNDRIVEN: (
        "the encoder counts although nothing is driven",
        "hold the robot still; else look for a loose ground or noise on the encoder's wires",
    ),
    WiringFault.EDGES_MISSED: (
        "both tracks change at once now and then: edges are missed",
        "shorten or shield the encoder's cable; check its supply and pull-ups",
    ),
    WiringFault.TRACKS_TOGETHER: (
        "both tracks always change together",
        "tracks A and B are connected to each other, or to one output of the encoder",
    ),
    WiringFault.TRACK_A: ("track A of its encoder shows no edge, track B does", "connect track A"),
    WiringFault.TRACK_B: ("track B of its encoder shows no edge, track A does", "connect track B"),
    WiringFault.CROSSED_TRACK: (
        "one track of its encoder is at its own input, the other at that of {other}",
        "put both tracks of each encoder to their own channel",
    ),
    WiringFault.CROSSED_AXES: (
        "driving it moves the encoder of {other}, and its own stands still",
        "look which shaft turned: its own: swap the encoders; that of {other}: swap the motors",
    ),
    WiringFault.REVERSED: (
        "positive duty counts down",
        "swap tracks A and B or the motor's wires; or set encoder_reversed or motor_reversed, whichever "
        "makes positive the sense that the robot file means",
    ),
    WiringFault.ONE_DIRECTION: (
        "it turns in one direction only",
        "an input line of its bridge is open; or an end stop or a tight tendon is in the way",
    ),
    WiringFault.SAME_DIRECTION: (
        "it turns the same way whatever the sign of the duty",
        "the direction line of its bridge is open, or `bridge` in the robot file is of another kind",
    ),
    WiringFault.NO_CURRENT: (
        "no current flows through the motor at 20 % duty",
        "connect the motor, and the supply of its bridge",
    ),
    WiringFault.DEAD_ENCODER: (
        "its current falls as that of a turning motor, but its encoder shows no edge",
        "check supply, ground and both tracks of the encoder",
    ),
    WiringFault.NO_MOTION: (
        "it does not move at 20 % duty; its current stays that of a standing motor",
        "loosen what blocks it, or its tendon; a shaft with more friction cannot be proven by pulses",
    ),
    WiringFault.NO_COUNT: (
        "it does not move at 20 % duty, or its encoder is dead; without a current sensor both look alike",
        "turn the shaft by hand and look whether `contid status` counts; check encoder, motor and supply",
    ),
    WiringFault.OTHER_TURNED: (
        "another part of the robot turned than the one that has this name",
        "exchange the channels or ids of the two axes in the robot file, or their plugs",
    ),
    WiringFault.WRONG_SENSE: (
        "it turned the other way than the robot file means",
        "change the sign of `direction` at the axis, then home it again",
    ),
}
#: The same of a servo, whose motor, encoder and bridge are one part.
SEALED: Final[dict[WiringFault, tuple[str, str]]] = {
    WiringFault.NONE: ("it turns the right way, and comes back", ""),
    WiringFault.FAULT_LINE: ("it reports a hardware error at rest; nothing was driven", "see below"),
    WiringFault.BRIDGE_TRIPS: ("it reports a hardware error when it drives", "see below"),
    WiringFault.UNDRIVEN: ("its position changes although nothing is driven", "hold the robot still"),
    WiringFault.CROSSED_AXES: (
        "driving it moves {other}, and its own position stands still",
        "look for the secondary id of {other}; or its encoder is dead, and the robot couples the two",
    ),
    WiringFault.REVERSED: (
        "positive PWM counts down",
        "reset it: `contid servo reset`; if it persists, replace the servo",
    ),
    WiringFault.ONE_DIRECTION: (
        "it turns in one direction only",
        "an end stop or a tight tendon is in the way",
    ),
    WiringFault.NO_COUNT: (
        "it does not move at 20 % of its PWM, or its encoder is dead",
        "loosen what blocks it, or its tendon, and measure its supply at the plug; then replace the servo",
    ),
}
