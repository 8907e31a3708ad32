"""Bring-up of a pressure regulator: two low steps, a vent, and the name of what is wrong.

One regulator at a time gets a command, through its bus as in a run; its board limits pressures, rates and
time. What the pressure outputs of all regulators of the bus read is compared with the command.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple, Protocol

from contid.errors import DeviceError
from contid.hal import Bus, Clock, Report, Rest, Sample
from contid.units import BAR
from contid_bringup.regulator_faults import (
    MEANINGS,
    NONE,
    Gauge,
    Held,
    RegulatorFault,
    name_regulator_fault,
)

#: Steps, as shares of the largest pressure of the axis; and the longest hold of each.
STEPS: Final = (0.1, 0.2)
HOLD_S: Final = 4.0
#: Between two exchanges; readings are averages over this time, and stand when two of them are equal.
_PERIOD_S: Final = 0.01
_WINDOW_S: Final = 0.1
_APART: Final = 2
_STANDS: Final = 0.03
_LISTEN_S: Final = 0.5
#: Vented: below this share of the higher step, within this time.
_VENTED: Final = 0.1
_VENT_S: Final = 10.0
#: A reading at rest this far from 0 is a tolerance of the output [Pa].
_REST_PA: Final = 2000.0


@dataclass
class RegulatorResult:
    """What was found about one regulator.

    Attributes:
        fault: its name, and ``other``: the other axis, or the scale.
        held: the steps.
        vent_s: time to a tenth; None when it did not vent, or was not pressurised.
        notes: what the board reported, a line each.
    """

    fault: RegulatorFault
    other: str = ""
    held: Sequence[Held] = ()
    vent_s: float | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        """``ok``, or the name of what is wrong."""
        return self.fault.value

    def lines(self) -> list[str]:
        """The findings, one a line."""
        message, remedy = (text.format(other=self.other) for text in MEANINGS[self.fault])
        steps = "; ".join(f"{h.command_pa / BAR:.3g} -> {h.last_pa / BAR:.3g} bar" for h in self.held)
        lines = [f"{self.name}: {message}" + (f" ({steps})" if steps else "")]
        lines += [f"-> {remedy}"] if remedy else []
        lines += [f"vents to a tenth in {self.vent_s * 1000:.0f} ms"] if self.vent_s is not None else []
        return lines + self.notes


class ByEye(Protocol):
    """Steps that a person looks at, while ``hold`` is called again and again to keep the command."""

    def gauge_bar(self, axis: str, hold: Callable[[], object]) -> float | None:
        """Ask for the highest pressure that a gauge at the chamber shows; None without one."""

    def dumped(self, axis: str, hold: Callable[[], object]) -> bool:
        """Ask to open the dump valve; false when there is none."""


def bring_up_regulator(
    bus: Bus,
    axis: str,
    others: Sequence[str],
    most_pa: float,
    clock: Clock,
    report: Report,
    *,
    by_eye: ByEye | None = None,
) -> RegulatorResult:
    """Prove one regulator; it is vented before and afterwards.

    Args:
        bus: open; nothing of it is commanded.
        axis: ``ROBOT.AXIS``.
        others: the other regulators of the bus.
        most_pa: largest pressure of the axis by the robot file; the steps are a tenth and a fifth of it.
        clock: of the bus.
        report: takes lines about the progress.
        by_eye: the person who reads a gauge and opens the dump valve; None without one.

    Raises:
        DeviceLostError: the bus is gone.
    """
    read = functools.partial(_read, bus, clock, (axis, *others))
    rest = read({}, _LISTEN_S)
    own = rest.means.get(axis)
    if own is None:
        return RegulatorResult(RegulatorFault.READ_BACK_OPEN, notes=_notes(rest.last[axis]))
    if abs(own) > NONE * STEPS[0] * most_pa + _REST_PA:
        fault = RegulatorFault.READ_BACK_HIGH if own > most_pa else RegulatorFault.AT_REST
        return RegulatorResult(fault, notes=[f"reads {own / BAR:.3g} bar at rest", *_notes(rest.last[axis])])
    try:
        bus.enable([axis])
    except DeviceError as error:
        return RegulatorResult(RegulatorFault.AT_REST, notes=[str(error)])
    held: list[Held] = []
    notes: list[str] = []
    gauge_bar = None
    try:
        for share in STEPS:
            report(f"{axis}: {share * most_pa / BAR:.3g} bar")
            step = _hold(read, axis, share * most_pa, rest.means)
            held.append(step.held)
            if step.sample.fault:
                # A scale is the same at a second step, a leak is not.
                notes = _notes(step.sample)
                _clear(bus, axis, read)
        again = functools.partial(_again, bus, axis, held[-1].command_pa, read)
        if by_eye is not None:
            gauge_bar = by_eye.gauge_bar(axis, again)
    finally:
        bus.disable([axis], Rest.VENT)
    fault, other = name_regulator_fault(held, stopped=bool(notes))
    if gauge_bar is not None:
        gauge = Gauge(held[-1], gauge_bar * BAR)
        notes.append(gauge.line())
        if fault is RegulatorFault.NONE and not gauge.agrees:
            return RegulatorResult(RegulatorFault.GAUGE, gauge.share, held, notes=notes)
    if fault not in (RegulatorFault.NONE, RegulatorFault.SCALE):
        return RegulatorResult(fault, other, held, notes=notes)
    vent_s = _vent_s(read, clock, axis, own + _VENTED * held[-1].last_pa)
    if fault is RegulatorFault.NONE and vent_s is None:
        fault = RegulatorFault.NOT_VENTED
    if fault is RegulatorFault.NONE and by_eye is not None:
        try:
            bus.enable([axis])
            read({axis: held[-1].command_pa}, HOLD_S / 2.0)
            if by_eye.dumped(axis, again):
                left_pa = again().means.get(axis, held[-1].command_pa)
                notes.append(f"dump valve open: {max(left_pa, 0.0) / BAR:.3g} bar")
                if left_pa > 2.0 * _VENTED * held[-1].command_pa:
                    fault = RegulatorFault.NOT_DUMPED
        finally:
            bus.disable([axis], Rest.VENT)
    return RegulatorResult(fault, other, held, vent_s, notes)


def _clear(bus: Bus, axis: str, read: _Read) -> None:
    """Vent, and enable again."""
    bus.disable([axis], Rest.VENT)
    read({}, HOLD_S / 2.0)
    bus.clear_fault([axis])
    bus.enable([axis])


def _again(bus: Bus, axis: str, command_pa: float, read: _Read) -> _Readings:
    """Hold a command for a moment; a step that the board ends begins anew."""
    readings = read({axis: command_pa}, _PERIOD_S)
    if readings.last[axis].fault:
        _clear(bus, axis, read)
    return readings


class _Readings(NamedTuple):
    """Averages of the valid readings [Pa], and the newest samples, by axis."""

    means: Mapping[str, float]
    last: Mapping[str, Sample]


_Read = Callable[[Mapping[str, float], float], _Readings]


def _read(
    bus: Bus, clock: Clock, names: Sequence[str], commands: Mapping[str, float], seconds: float
) -> _Readings:
    """Exchange for a time."""
    seen: dict[str, list[float]] = {name: [] for name in names}
    until = clock.now() + seconds
    while True:
        samples = bus.exchange(commands)
        for name in names:
            value = samples[name].value
            if samples[name].valid and value is not None:
                seen[name].append(value)
        if clock.now() >= until:
            return _Readings({n: sum(v) / len(v) for n, v in seen.items() if v}, samples)
        clock.sleep(_PERIOD_S)


class _Step(NamedTuple):
    held: Held
    sample: Sample


def _hold(read: _Read, axis: str, command_pa: float, rest: Mapping[str, float]) -> _Step:
    """Hold a command until the reading stands, at least a third of `HOLD_S`."""
    seen: list[float] = []
    way: Mapping[str, float] = {}
    windows = round(HOLD_S / _WINDOW_S)
    for window in range(windows):
        readings = read({axis: command_pa}, _WINDOW_S)
        if stopped := bool(readings.last[axis].fault):
            break  # the board vents it
        way = {name: value - rest.get(name, 0.0) for name, value in readings.means.items()}
        seen.append(way.get(axis, 0.0))
        if window > windows // 3 and abs(seen[-1] - seen[-1 - _APART]) < _STANDS * command_pa:
            break
    others = {name: value for name, value in way.items() if name != axis}
    last = _limit(seen) if stopped else seen[-1]
    return _Step(Held(command_pa, max(seen, default=0.0), last, others), readings.last[axis])


def _limit(seen: Sequence[float]) -> float:
    """Where readings that approach a value exponentially go (Aitken's formula); the last one for others.

    A board ends a step that reads half of its command for some time, often before the reading stands.
    """
    if len(seen) < 3:
        return seen[-1] if seen else 0.0
    first, second, third = seen[-3:]
    before, after = second - first, third - second
    return third + after**2 / (before - after) if 0.0 < after < 0.9 * before else third


def _vent_s(read: _Read, clock: Clock, axis: str, below_pa: float) -> float | None:
    begin = clock.now()
    while clock.now() - begin < _VENT_S:
        if read({}, 0.0).means.get(axis, below_pa) < below_pa:
            return clock.now() - begin
        clock.sleep(_PERIOD_S)
    return None


def _notes(sample: Sample) -> list[str]:
    return [f"the board reports: {sample.fault}"] if sample.fault else []
