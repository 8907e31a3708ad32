"""From the answers to pulses to the name of what is wrong; a pure function."""

from __future__ import annotations

import enum
import itertools
from collections.abc import Sequence
from typing import Final, NamedTuple

from contid.hal.pulses import EncoderAnswer, PulseAnswer
from contid_bringup.probing import STIRRED, total

#: A turning motor draws less than a standing one: its current falls by this share while it is driven.
_FALLS: Final = 0.12
#: A motor that is connected draws this share of its stall current at full duty, times the duty.
_FLOWS: Final = 0.1
_FIRST_CURRENT: Final = 1  # the inductance has passed


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


class Verdict(NamedTuple):
    """What the pulses of one axis showed.

    Attributes:
        fault: its name; ``WiringFault.NONE`` for a proven axis.
        other: the other axis or input concerned, "" for none.
        sealed: of a servo.
    """

    fault: WiringFault
    other: str = ""
    sealed: bool = False

    @property
    def _meaning(self) -> tuple[str, str]:
        meanings = MEANINGS | SEALED if self.sealed else MEANINGS
        return meanings[self.fault]

    @property
    def message(self) -> str:
        """What was seen."""
        return self._meaning[0].format(other=self.other)

    @property
    def remedy(self) -> str:
        """What to do about it."""
        return self._meaning[1].format(other=self.other)


def name_fault(answers: Sequence[PulseAnswer], stall_a: float = 0.0) -> Verdict:
    """Name what the pulses of `contid_bringup.probing.probe` show.

    Args:
        answers: in their order; the first without duty.
        stall_a: stall current of the robot file [A]; 0 without a sensor.
    """
    listening, driven = answers[0], answers[1:]
    if listening.fault:
        return Verdict(WiringFault.FAULT_LINE)
    if listening.own.edges >= STIRRED:
        return Verdict(WiringFault.UNDRIVEN)
    if any(answer.fault for answer in driven):
        return Verdict(WiringFault.BRIDGE_TRIPS)
    own = total(driven, driven[0].axis)
    if own.missed >= STIRRED:
        together = own.missed >= own.edges // 2 - 1 and abs(own.counts) <= 1
        return Verdict(WiringFault.TRACKS_TOGETHER if together else WiringFault.EDGES_MISSED)
    if own.edges < STIRRED:
        return _unanswered(driven, listening, stall_a)
    if (alone := _track_alone(driven, driven[0].axis)) != "":
        return _one_track(driven, alone)
    return _directions(driven)


def _others(answers: Sequence[PulseAnswer]) -> dict[str, EncoderAnswer]:
    names = [name for name in answers[0].encoders if name != answers[0].axis]
    return {name: total(answers, name) for name in names}


def _unanswered(driven: Sequence[PulseAnswer], listening: PulseAnswer, stall_a: float) -> Verdict:
    """Its own encoder stands still."""
    others = _others(driven)
    if others:
        name = max(others, key=lambda each: others[each].edges)
        if others[name].edges >= STIRRED:
            return Verdict(WiringFault.CROSSED_AXES, name)
    strongest = max(driven, key=lambda answer: abs(answer.duty))
    currents = [abs(value) for value in _while_driven(strongest)]
    if not currents or stall_a <= 0.0:
        return Verdict(WiringFault.NO_COUNT)
    at_rest = [abs(value) for value in listening.currents_a]
    offset = sum(at_rest) / len(at_rest) if at_rest else 0.0
    first, last = currents[0] - offset, currents[-1] - offset
    if max(first, last) < _FLOWS * abs(strongest.duty) * stall_a:
        return Verdict(WiringFault.NO_CURRENT)
    return Verdict(WiringFault.DEAD_ENCODER if last < (1.0 - _FALLS) * first else WiringFault.NO_MOTION)


def _while_driven(answer: PulseAnswer) -> tuple[float, ...]:
    """Currents while it was driven, averaged over pairs against noise."""
    count = int(answer.driven_s * 1000.0) // 2
    driven = answer.currents_a[_FIRST_CURRENT:count]
    return tuple((a + b) / 2.0 for a, b in itertools.pairwise(driven))


def _runs(answers: Sequence[PulseAnswer]) -> list[list[PulseAnswer]]:
    """The pulses, parted where the duty changes its sign."""
    runs: list[list[PulseAnswer]] = []
    for answer in answers:
        if runs and runs[-1][-1].duty * answer.duty > 0.0:
            runs[-1].append(answer)
        else:
            runs.append([answer])
    return runs


def _track_alone(answers: Sequence[PulseAnswer], name: str) -> str:
    """The only track with edges, "" for both.

    A shaft that turns one way shows edges of the two tracks in turn. One that goes to and fro over a single
    edge may show those of one track; so only pulses in one direction count.
    """
    runs = [total(run, name) for run in _runs(answers)]
    for track, edges, other in (
        ("a", [run.edges_a for run in runs], [run.edges_b for run in runs]),
        ("b", [run.edges_b for run in runs], [run.edges_a for run in runs]),
    ):
        if max(edges) >= STIRRED and sum(other) == 0:
            return track
    return ""


def _one_track(driven: Sequence[PulseAnswer], alone: str) -> Verdict:
    missing = "b" if alone == "a" else "a"
    for name in _others(driven):
        if _track_alone(driven, name) == missing:
            return Verdict(WiringFault.CROSSED_TRACK, name)
    return Verdict(WiringFault.TRACK_B if alone == "a" else WiringFault.TRACK_A)


def _directions(driven: Sequence[PulseAnswer]) -> Verdict:
    up = total([answer for answer in driven if answer.duty > 0.0], driven[0].axis)
    down = total([answer for answer in driven if answer.duty < 0.0], driven[0].axis)
    if max(abs(up.counts), abs(down.counts)) >= STIRRED and min(up.edges, down.edges) < STIRRED - 1:
        return Verdict(WiringFault.ONE_DIRECTION)
    if up.counts > 0 > down.counts:
        return Verdict(WiringFault.NONE)
    if up.counts < 0 < down.counts:
        return Verdict(WiringFault.REVERSED)
    if abs(up.counts) >= STIRRED and abs(down.counts) >= STIRRED:
        return Verdict(WiringFault.SAME_DIRECTION)
    return Verdict(WiringFault.NO_COUNT)
