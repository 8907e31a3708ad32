"""Bring-up of one motor or servo: pulses, the name of what is wrong, its numbers, what a person sees."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from contid.hal import Report
from contid_bringup.backlash import measure_backlash
from contid_bringup.drive_fit import DriveFit, MeanOfPulses, fit_drive, measure
from contid_bringup.naming import Verdict, name_fault
from contid_bringup.probing import DUTY_MOST, Pulse, blind_s, from_rest, probe
from contid_bringup.timed_fit import fit_timed
from contid_bringup.wiring_faults import WiringFault
from contid_devices.pulsed_motors import DriveFacts, PulsedBus

#: A turn by hand is accurate to this share.
_BY_HAND: Final = 0.05
#: Times to and fro of a wiggle.
_WIGGLES: Final = 4


@dataclass(frozen=True)
class MotorResult:
    """What was found about one motor.

    Attributes:
        verdict: what the pulses showed.
        pulses: how many, and ``most_duty`` the strongest of them.
        fit: friction, top speed, time constant; None for a faulty axis, and where it moved too little.
        backlash_deg: seen behind the gear; None where `fit` is, for servos, and of one wider than a pulse.
        counts_by_hand: counts of one turn by hand; None when it was skipped.
        counts_per_rev: those of the robot file.
        notes: what else was found, a line each.
    """

    verdict: Verdict
    pulses: int
    most_duty: float
    fit: DriveFit | None
    backlash_deg: MeanOfPulses | None
    counts_by_hand: int | None
    counts_per_rev: float
    notes: Sequence[str] = ()

    @property
    def name(self) -> str:
        """``ok``, or the name of what is wrong."""
        return "counts-per-rev" if self.miscounted else self.verdict.fault.value

    @property
    def miscounted(self) -> bool:
        """True when the turn by hand disagrees with the robot file."""
        if self.counts_by_hand is None:
            return False
        return abs(abs(self.counts_by_hand) / self.counts_per_rev - 1.0) > _BY_HAND

    def lines(self) -> list[str]:
        """The findings, one a line."""
        found = [
            f"{self.name}: {self.verdict.message} ({self.pulses} pulses of at most {self.most_duty:.1%})"
        ]
        if self.verdict.remedy:
            found.append(f"-> {self.verdict.remedy}")
        if self.miscounted:
            found.append(
                f"-> one turn by hand gave {self.counts_by_hand} counts, the file has counts_per_rev "
                f"{self.counts_per_rev:g}: count edges of both tracks (4 per line) times the gear ratio"
            )
        if self.fit is not None:
            found += [
                f"{name} {estimate.value * scale:.4g} {unit} (+- {estimate.deviation * scale:.2g})"
                + ("" if estimate.certain else ": not sure enough to be written")
                for name, estimate, scale, unit in (
                    ("friction", self.fit.friction, 100.0, "%"),
                    ("no-load speed", self.fit.no_load_deg_s, 1.0, "deg/s"),
                    ("time constant", self.fit.time_constant_s, 1000.0, "ms"),
                )
            ]
        if self.backlash_deg is not None:
            play, deviation = self.backlash_deg
            found.append(
                f"backlash {play:.2g} deg (+- {deviation:.1g})"
                if play > 3.0 * deviation
                else f"backlash below {max(play, 0.0) + 3.0 * deviation:.2g} deg"
            )
        return [*found, *self.notes]


class ByHand(Protocol):
    """A person beside the robot."""

    def turned(self, axis: str) -> bool:
        """Ask for one turn of the output shaft by hand; False when it was not made."""

    def saw(self, axis: str, wiggle: Callable[[], None]) -> WiringFault:
        """Ask which part turned and which way; ``wiggle`` moves it to and fro, first as its value rises."""


def bring_up_motor(
    bus: PulsedBus,
    axis: str,
    facts: DriveFacts,
    report: Report,
    by_hand: ByHand | None = None,
    sense: int = 1,
) -> MotorResult:
    """Prove one motor or servo.

    Args:
        bus: open for pulses.
        axis: ``ROBOT.AXIS``.
        facts: what the robot file states about it.
        report: takes lines about the progress.
        by_hand: a person who is asked; None: without one.
        sense: of the device, 1 or -1, in which the value of the axis rises.

    Raises:
        DeviceError: the device refuses a pulse, or does not answer.
    """
    pulse = functools.partial(bus.pulse, axis)
    report(f"{axis}: pulses of at most 30 ms, rising to at most 20 % until it stirs")
    answers = probe(pulse, facts)
    verdict = name_fault(answers, facts.stall_a)
    fit, backlash, counted = None, None, None
    if verdict.fault is WiringFault.NONE:
        report(f"{axis}: motor and encoder answer; measuring friction, speed and time constant")
        found = abs(answers[-1].duty)
        answers += measure(pulse, found, facts)
        if answers[-1].fault:
            verdict = Verdict(WiringFault.BRIDGE_TRIPS)
        else:
            fit = fit_timed(answers, facts) if facts.sealed else fit_drive(answers, facts)
            if by_hand is not None:
                verdict = Verdict(by_hand.saw(axis, functools.partial(_wiggle, pulse, facts, sense, found)))
    if verdict.fault is WiringFault.NONE and fit is not None and not facts.sealed:
        backlash = measure_backlash(pulse, facts)
    if verdict.fault is WiringFault.NONE and by_hand is not None and not facts.sealed:
        before = bus.counts(axis)
        if by_hand.turned(axis):
            counted = bus.counts(axis) - before
    most = max(abs(answer.duty) for answer in answers)
    verdict = verdict._replace(sealed=facts.sealed)
    notes = bus.notes(axis)
    return MotorResult(verdict, len(answers), most, fit, backlash, counted, facts.counts_per_rev, notes)


def _wiggle(pulse: Pulse, facts: DriveFacts, sense: int, found_duty: float) -> None:
    """To and fro by a degree or so: first in the sense in which the value of the axis rises."""
    duty = sense * 0.5 * (found_duty + DUTY_MOST)
    for sign in (+1.0, -1.0) * _WIGGLES:
        from_rest(pulse)(sign * duty, blind_s(facts, duty))
