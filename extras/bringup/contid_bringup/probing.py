"""Which pulses prove a motor and its encoder: as weak as it turns with, and within a few counts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

from contid.hal.pulses import EncoderAnswer
from contid_devices.pulsed_motors import DriveFacts, PulseAnswer

#: Bounds of the device.
DUTY_MOST: Final = 0.2
PULSE_S: Final = 0.03
#: Duty rises by this from pulse to pulse until something stirs.
LADDER: Final = 0.015
#: Further duty for a shaft that moves little, in all and per pulse.
EXTRA: Final = 0.05
EXTRA_STEP: Final = 0.01
#: Pulses in one direction at the highest duty, and in one direction once it stirs.
TRIES: Final = 12
#: Edges that are motion, and not a shaft that trembles at one edge of its encoder.
STIRRED: Final = 3
#: Edges of each track that prove it, and of one track alone that show the other one dead.
PROVEN: Final = 3
ALONE: Final = 4

#: Way that pulses may cause whose encoder shows nothing, to each side [deg].
BLIND_DEG: Final = 1.5
#: Of the friction in the robot file that such a way is reckoned with.
_FRICTION_LEAST: Final = 0.5

#: Count that stands still at the end of a trace; and traces that are waited for.
_STILL_MS: Final = 30
_WAITS: Final = 20

#: Drives one axis open loop: duty and duration [s].
Pulse = Callable[[float, float], PulseAnswer]


def from_rest(pulse: Pulse) -> Pulse:
    """The same pulses, each followed by traces without drive until the shaft stands."""

    def settled(duty: float, duration_s: float) -> PulseAnswer:
        answer = last = pulse(duty, duration_s)
        for _ in range(_WAITS):
            if duty == 0.0 or last.fault or last.positions[-1:] == last.positions[-_STILL_MS:][:1]:
                break
            last = pulse(0.0, PULSE_S)
        return answer

    return settled


def way_deg(facts: DriveFacts, duty: float, duration_s: float) -> float:
    """How far one pulse turns a motor of first order, until it stands again [deg].

    tau dv/dt = (|duty| - f) v0 - v under drive; then -f v0 - v with its terminals shorted, -f v0 without. The
    friction f is half of that in the robot file: less friction is a longer way.
    """
    tau, top, friction = facts.time_constant_s, facts.no_load_deg_s, _FRICTION_LEAST * facts.friction
    excess = (abs(duty) - friction) * top
    if excess <= 0.0:
        return 0.0
    if tau <= 0.0:
        return excess * duration_s
    rise = 1.0 - math.exp(-duration_s / tau)
    speed, driven = excess * rise, excess * (duration_s - tau * rise)
    hold = max(friction * top, 1e-3 * top)
    if facts.brakes:
        return driven + tau * (speed - hold * math.log1p(speed / hold))
    return driven + speed**2 * tau / (2.0 * hold)


def blind_s(facts: DriveFacts, duty: float) -> float:
    """Duration [s] of a pulse that turns a motor by `BLIND_DEG` at most, in whole milliseconds."""
    ms = round(PULSE_S * 1000.0)
    while ms > 1 and way_deg(facts, duty, ms / 1000.0) > BLIND_DEG:
        ms -= 1
    return ms / 1000.0


def probe(pulse: Pulse, facts: DriveFacts) -> list[PulseAnswer]:
    """Pulses of one axis until it is proven, or until more would prove nothing; the first has no duty.

    The duty rises until an encoder stirs, to either side in turn. Nothing bounds the way of a shaft whose
    encoder is dead but what the robot file states about its motor: such pulses are short. If nothing stirs at
    20 %, more pulses to one side, then to the other, find a slow one. Then a run of pulses in each direction.
    """
    pulse = from_rest(pulse)
    answers = [pulse(0.0, PULSE_S)]
    if answers[0].fault or answers[0].own.edges >= STIRRED:
        return answers
    stirs = (
        _ladder(pulse, answers, facts)
        or _blind_run(pulse, answers, facts, +1.0, BLIND_DEG)
        or _blind_run(pulse, answers, facts, -1.0, 2.0 * BLIND_DEG)
    )
    if not stirs:
        return answers
    found = abs(answers[-1].duty)
    way = 0
    for sign in (-1.0, +1.0):
        if answers[-1].fault:
            break
        way = _run(pulse, answers, found, sign, way)
    return answers


def _ladder(pulse: Pulse, answers: list[PulseAnswer], facts: DriveFacts) -> bool:
    """Raise the duty until something stirs; True when it did, or when a fault ended it."""
    duty = LADDER
    while duty < DUTY_MOST:
        for sign in (+1.0, -1.0):
            answers.append(pulse(sign * duty, blind_s(facts, duty)))
            if answers[-1].fault or _most(answers[-1:]) >= STIRRED:
                return True
        duty += LADDER
    return False


def _blind_run(
    pulse: Pulse, answers: list[PulseAnswer], facts: DriveFacts, sign: float, room_deg: float
) -> bool:
    """Pulses of 20 % to one side while the room lasts; True when something stirs."""
    duration_s = blind_s(facts, DUTY_MOST)
    step_deg = way_deg(facts, DUTY_MOST, duration_s)
    run: list[PulseAnswer] = []
    while len(run) < TRIES and step_deg * (len(run) + 1) <= room_deg:
        run.append(pulse(sign * DUTY_MOST, duration_s))
        answers.append(run[-1])
        if run[-1].fault or _most(run) >= STIRRED:
            return True
    return False


def _run(pulse: Pulse, answers: list[PulseAnswer], found: float, sign: float, before: int) -> int:
    """Pulses in one direction until both tracks are proven, or one is dead; returns the counts.

    A shaft that goes on the way of the run ``before`` [counts] does not come back: a few counts of a short
    pulse suffice.
    """
    run: list[PulseAnswer] = []
    duty = found
    for _ in range(TRIES):
        run.append(pulse(sign * duty, PULSE_S if run or not before else 0.5 * PULSE_S))
        answers.append(run[-1])
        counts = sum(answer.own.counts for answer in run)
        same_way = counts * before > 0 and abs(counts) >= STIRRED
        if run[-1].fault or _proven(run) or same_way:
            break
        if _most(run[-1:]) < STIRRED - 1:
            duty = min(duty + EXTRA_STEP, found + EXTRA, DUTY_MOST)
    return sum(answer.own.counts for answer in run)


def total(answers: Sequence[PulseAnswer], name: str) -> EncoderAnswer:
    """What one encoder showed in all of the pulses; zeros where none of them has it."""
    found = [answer.encoders[name] for answer in answers if name in answer.encoders]
    return EncoderAnswer(*map(sum, zip(EncoderAnswer(0, 0, 0, 0), *found, strict=True)))


def _most(run: Sequence[PulseAnswer]) -> int:
    """Edges of the encoder that shows most."""
    return max(total(run, name).edges for name in run[0].encoders)


def _proven(run: Sequence[PulseAnswer]) -> bool:
    for name in run[0].encoders:
        _, a, b, _ = total(run, name)
        if min(a, b) >= PROVEN or (min(a, b) == 0 and max(a, b) >= ALONE):
            return True
    return False
