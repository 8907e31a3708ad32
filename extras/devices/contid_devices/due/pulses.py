"""Open-loop pulses of a Due board: order, wait for the end of the trace, read it."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from typing import Final

from contid.errors import DeviceError
from contid.hal import AxisOnBus, DeviceKind, Rest
from contid.hal.pulses import EncoderAnswer, ProvenDevice
from contid_devices.pulsed_motors import DriveFacts, PulseAnswer
from contid_driverkit.clock import MonotonicClock
from contid_driverkit.signals import defer_signals
from contid_drivers.due.bus import DueBus
from contid_drivers.due.codes import DUTY_FULL, TRACE_MS, Reason, Refusal
from contid_drivers.due.identity import board
from contid_drivers.due.messages import PulseTrace
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, SafeState
from contid_drivers.due.session import BoardRefusedError
from contid_drivers.due.wiring import axis_options

#: The trace is asked for at this interval, and must be over within this time.
_POLL_S: Final = 0.02
_TRACE_S: Final = 2.0


class DuePulsedBus:
    """A Due board whose motors are pulsed one at a time (`contid_devices.pulsed_motors.PulsedBus`)."""

    def __init__(self, bus: DueBus, axes: Sequence[AxisOnBus]) -> None:
        self._bus = bus
        self._options = {axis.name: axis_options(axis) for axis in axes}
        self._capabilities = bus.hello.capabilities

    def device(self, axis: str) -> ProvenDevice:
        """The board."""
        return board(self._bus.hello)

    def notes(self, axis: str) -> Sequence[str]:
        """Nothing further."""
        return ()

    def pulse(self, axis: str, duty: float, duration_s: float) -> PulseAnswer:
        """Drive one axis open loop, and read what every encoder showed.

        See `contid_devices.pulsed_motors.PulsedBus`; the board bounds duty and time, and ends the drive.
        """
        ms = round(duration_s * 1000.0)
        try:
            self._bus.pulse(axis, round(duty * DUTY_FULL), ms)
        except BoardRefusedError as refused:
            # Faults were cleared: what is latched still has a cause that persists.
            if refused.refusal not in (Refusal.PERSISTS, Refusal.LATCHED):
                raise
            nothing = {name: EncoderAnswer(0, 0, 0, 0) for name in self._options}
            return PulseAnswer(axis, duty, ms / 1000.0, 0.0, nothing, (), fault=True)
        trace = self._trace(axis)
        self._bus.exchange({})
        if self._bus.reason(axis) is Reason.BRIDGE:
            with suppress(DeviceError):
                self._bus.clear_fault([axis])
        has_current = self._options[axis].stall_current_ma > 0
        return PulseAnswer(
            axis,
            trace.duty / DUTY_FULL,
            trace.ordered_ms / 1000.0,
            trace.driven_ms / 1000.0,
            self._answers(trace.encoders),
            trace.positions,
            fault=bool(trace.faults),
            currents_a=tuple(ma / 1000.0 for ma in trace.currents_ma) if has_current else (),
        )

    def _trace(self, axis: str) -> PulseTrace:
        time.sleep(TRACE_MS / 1000.0)
        until = time.monotonic() + _TRACE_S
        while time.monotonic() < until:
            trace = self._bus.pulse_trace()
            if trace is not None and trace.complete:
                return trace
            time.sleep(_POLL_S)
        raise DeviceError(
            f"{self._bus.name}: {axis}", "no trace of its pulse", "check the cable of the board"
        )

    def _answers(self, encoders: Sequence[EncoderAnswer]) -> Mapping[str, EncoderAnswer]:
        names = {options.number: name for name, options in self._options.items()}
        return {
            names.get(i, f"channel m{i}"): answer
            for i, answer in enumerate(encoders)
            if self._capabilities[i]
        }

    def counts(self, axis: str) -> int:
        """Count of the axis's encoder now; moves nothing."""
        self._bus.exchange({})
        telemetry = self._bus.telemetry
        assert telemetry is not None
        return telemetry.channels[self._options[axis].number].position


@contextmanager
def pulsed_bus(name: str, options: DueBusOptions, axes: Sequence[AxisOnBus]) -> Iterator[DuePulsedBus]:
    """Open a board for pulses; latched faults are cleared, and every motor is without power on exit."""
    with closing(DueBus(name, options, axes, MonotonicClock())) as bus:
        bus.open()
        try:
            for axis in bus.axes:
                with suppress(DeviceError):  # a fault of the bridge persists; its pulse reports it
                    bus.clear_fault([axis])
            # After it: a motor that its watchdog left holding holds on when it is cleared.
            bus.disable(bus.axes, Rest.RELAX)
            yield DuePulsedBus(bus, axes)
        finally:
            with defer_signals():
                bus.disable(bus.axes, Rest.RELAX)


def drive_facts(axis: DueAxisOptions) -> DriveFacts | None:
    """What the file states about the motor of an axis; None for a regulator."""
    if axis.kind is not DeviceKind.MOTOR:
        return None
    return DriveFacts(
        axis.counts_per_rev,
        axis.start is not SafeState.COAST,
        axis.friction_percent / 100.0,
        axis.no_load_deg_s,
        axis.time_constant_ms / 1000.0,
        axis.stall_current_ma / 1000.0,
    )
