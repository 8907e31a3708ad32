"""From the answers to pulses to the name of what is wrong; a pure function."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Final, NamedTuple

from contid.hal.pulses import EncoderAnswer
from contid_bringup.probing import STIRRED, total
from contid_bringup.wiring_faults import MEANINGS, SEALED, WiringFault
from contid_devices.pulsed_motors import PulseAnswer

#: A turning motor draws less than a standing one: its current falls by this share while it is driven.
_FALLS: Final = 0.12
#: A motor that is connected draws this share of its stall current at full duty, times the duty.
_FLOWS: Final = 0.1
_FIRST_CURRENT: Final = 1  # the inductance has passed


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
