"""From what regulators read while one is commanded to the name of what is wrong; a pure function."""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

#: Answers, as shares of a step: none; right; half and double.
NONE: Final = 0.1
_RIGHT: Final = 0.1
_HALF: Final = (0.42, 0.58)
_DOUBLE: Final = (1.7, 2.3)
#: The two steps have one scale.
_SAME: Final = 0.08
#: A reading falls by this share of a step while it is held.
_SAGS: Final = 0.08


class RegulatorFault(enum.StrEnum):
    """Name of what is wrong with a pressure regulator or its two wires."""

    NONE = "ok"
    READ_BACK_OPEN = "read-back-open"
    READ_BACK_HIGH = "read-back-high"
    AT_REST = "pressure-at-rest"
    NO_ANSWER = "no-answer"
    CROSSED = "crossed-axes"
    HALF = "half-scale"
    DOUBLE = "double-scale"
    SCALE = "wrong-scale"
    LEAK = "leak"
    NOT_VENTED = "does-not-vent"
    STOPPED = "board-fault"
    GAUGE = "gauge-disagrees"
    NOT_DUMPED = "does-not-dump"


#: What each name means, and what to do.
MEANINGS: Final[dict[RegulatorFault, tuple[str, str]]] = {
    RegulatorFault.NONE: ("its pressure follows the command, and vents", ""),
    RegulatorFault.READ_BACK_OPEN: (
        "its pressure output is below the signal of a connected one",
        "connect the wire of its pressure output, and the regulator's supply",
    ),
    RegulatorFault.READ_BACK_HIGH: (
        "its pressure output is at the end of its range without a command",
        "look for a short of that wire to the supply, or a missing divider",
    ),
    RegulatorFault.AT_REST: (
        "it reads a pressure without a command",
        "measure its command: it must be 0 V; else correct the first row of `readback` (a 4-20 mA output)",
    ),
    RegulatorFault.NO_ANSWER: (
        "no reading follows its command",
        "look at a gauge: with pressure the wire of its pressure output is open, without it that of "
        "its command, its supply or its air",
    ),
    RegulatorFault.CROSSED: (
        "its command raises the reading of {other}, and its own stands still",
        "look which chamber fills: its own: exchange the pressure outputs; that of {other}: the commands",
    ),
    RegulatorFault.HALF: (
        "its reading is half of the command",
        "look at a gauge: with half of the pressure a 0-10 V command is at a 0-5 V output, else the "
        "pressure output has half of its range; correct the wiring, or `calibration` or `readback`",
    ),
    RegulatorFault.DOUBLE: (
        "its reading is double the command",
        "look at a gauge: with double the pressure a 0-5 V command is at a 0-10 V output, else the "
        "pressure output has double its range; correct the wiring, or `calibration` or `readback`",
    ),
    RegulatorFault.SCALE: (
        "its reading is {other} of the command",
        "measure `calibration` and `readback` with a gauge",
    ),
    RegulatorFault.LEAK: (
        "its reading falls behind while the command is held",
        "look for a leak in chamber, tube and fittings, and whether the air supply is strong enough",
    ),
    RegulatorFault.NOT_VENTED: (
        "its reading does not fall when it vents",
        "look for a blocked exhaust or a kinked tube; its reading may be frozen",
    ),
    RegulatorFault.GAUGE: (
        "its reading is the command, but a gauge at the chamber shows {other} of it",
        "command and pressure output have the same wrong scale: correct both `calibration` and `readback`",
    ),
    RegulatorFault.NOT_DUMPED: (
        "the dump valve does not empty its chamber",
        "look whether the emergency stop opens the dump valve, and whether this chamber is behind it",
    ),
    RegulatorFault.STOPPED: ("its board ended the step", "see its report below"),
}


class Held(NamedTuple):
    """What was read while a command was held: averages, less those at rest.

    Attributes:
        command_pa: the command; 0 at rest.
        first_pa, last_pa: of the axis, highest on the way, and at the end.
        others_pa: of the other regulators at the end, by name.
    """

    command_pa: float
    first_pa: float
    last_pa: float
    others_pa: Mapping[str, float]

    @property
    def share(self) -> float:
        """The reading as a share of the command."""
        return self.last_pa / self.command_pa

    @property
    def right(self) -> bool:
        """Whether the reading is the command."""
        return abs(self.share - 1.0) <= _RIGHT


class RegulatorVerdict(NamedTuple):
    """A name, and ``other``: the other axis, or the scale; "" for none."""

    fault: RegulatorFault
    other: str = ""


class Gauge(NamedTuple):
    """What a gauge at the chamber showed while a command was held [Pa]."""

    held: Held
    shown_pa: float

    @property
    def agrees(self) -> bool:
        """Whether it shows the command."""
        return abs(self.shown_pa - self.held.command_pa) <= _RIGHT * self.held.command_pa

    @property
    def share(self) -> str:
        """Its pressure as a share of the command."""
        return f"{self.shown_pa / self.held.command_pa:.0%}"

    def line(self) -> str:
        """A finding: which side of a wrong scale it is, that of the command or that of the reading."""
        text = f"gauge: {self.shown_pa / 1e5:.3g} bar"
        if self.agrees:
            right = (
                "" if self.held.right else ": its command is right, its pressure output or `readback` is not"
            )
            return text + right
        near = _RIGHT * self.held.command_pa
        if abs(self.shown_pa - self.held.last_pa) <= near and not self.held.right:
            return f"{text}: its pressure output is right, its command or `calibration` is not"
        return f"{text}: command and pressure output are both wrong"


def name_regulator_fault(held: Sequence[Held], stopped: bool) -> RegulatorVerdict:
    """Name what the steps show; ``stopped``: the board ended one."""
    last = held[-1]
    if last.share < NONE and last.first_pa < NONE * last.command_pa:
        name = max(last.others_pa, key=lambda each: last.others_pa[each], default="")
        if name and last.others_pa[name] > 2.0 * NONE * last.command_pa:
            return RegulatorVerdict(RegulatorFault.CROSSED, name)
        return RegulatorVerdict(RegulatorFault.NO_ANSWER)
    shares = [each.share for each in held]
    sags = any(each.first_pa - each.last_pa > _SAGS * each.command_pa for each in held)
    share = shares[-1]
    same = max(shares) - min(shares) <= _SAME
    if _HALF[0] <= share <= _HALF[1] and same and not sags:
        return RegulatorVerdict(RegulatorFault.HALF)
    if share < 1.0 - _RIGHT and (sags or stopped or not same):
        return RegulatorVerdict(RegulatorFault.LEAK)
    if last.right:
        return RegulatorVerdict(RegulatorFault.STOPPED if stopped else RegulatorFault.NONE)
    if _DOUBLE[0] <= share <= _DOUBLE[1]:
        return RegulatorVerdict(RegulatorFault.DOUBLE)
    return RegulatorVerdict(RegulatorFault.SCALE, f"{share:.0%}")
