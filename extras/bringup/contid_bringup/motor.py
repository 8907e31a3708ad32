"""Bring-up of one motor with an encoder: pulses, the name of what is wrong, its numbers, one turn by hand."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from contid.hal import Report
from contid.hal.pulses import DriveFacts, PulsedBus
from contid_bringup.drive_fit import DriveFit, fit_drive, measure
from contid_bringup.naming import Verdict, WiringFault, name_fault
from contid_bringup.probing import probe

#: A turn by hand is accurate to this share.
_BY_HAND: Final = 0.05


@dataclass(frozen=True)
class MotorResult:
    """What was found about one motor.

    Attributes:
        verdict: what the pulses showed.
        pulses: how many, and ``most_duty`` the strongest of them.
        fit: friction, top speed, time constant; None for a faulty axis, and where it moved too little.
        counts_by_hand: counts of one turn by hand; None when it was skipped.
        counts_per_rev: those of the robot file.
    """

    verdict: Verdict
    pulses: int
    most_duty: float
    fit: DriveFit | None
    counts_by_hand: int | None
    counts_per_rev: float

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
        return found


def bring_up_motor(
    bus: PulsedBus, axis: str, facts: DriveFacts, report: Report, turn_by_hand: Callable[[str], bool] | None
) -> MotorResult:
    """Prove one motor.

    Args:
        bus: open for pulses.
        axis: ``ROBOT.AXIS``.
        facts: what the robot file states about it.
        report: takes lines about the progress.
        turn_by_hand: asks for one turn by hand, and returns whether it was made; None: not asked for.

    Raises:
        DeviceError: the device refuses a pulse, or does not answer.
    """
    pulse = functools.partial(bus.pulse, axis)
    report(f"{axis}: pulses of at most 30 ms, rising to at most 20 % until it stirs")
    answers = probe(pulse, facts)
    verdict = name_fault(answers, facts.stall_a)
    fit, by_hand = None, None
    if verdict.fault is WiringFault.NONE:
        report(f"{axis}: motor and encoder answer; measuring friction, speed and time constant")
        answers += measure(pulse, abs(answers[-1].duty))
        if answers[-1].fault:
            verdict = Verdict(WiringFault.BRIDGE_TRIPS)
    if verdict.fault is WiringFault.NONE:
        fit = fit_drive(answers, facts)
        before = bus.counts(axis)
        if turn_by_hand is not None and turn_by_hand(axis):
            by_hand = bus.counts(axis) - before
    most = max(abs(answer.duty) for answer in answers)
    return MotorResult(verdict, len(answers), most, fit, by_hand, facts.counts_per_rev)
