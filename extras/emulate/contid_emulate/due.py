"""Emulated Due board: the firmware built for this computer, on a pty, with a simulated plant."""

from __future__ import annotations

import contextlib
import math
import signal
import subprocess
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal, Self, TypeAlias, get_args

from pydantic import Field

from contid.errors import DeviceError
from contid.hal import AxisOnBus, DeviceKind
from contid.robot_file.base import Strict
from contid.units import BAR
from contid_devices.due.firmware_build import build_host
from contid_driverkit.control_file import ControlFile
from contid_drivers.due.codes import CHANNELS
from contid_drivers.due.motor_options import LoadCell
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, SafeState
from contid_drivers.due.wiring import DUE_ADC, Adc, axis_options

ChannelFault: TypeAlias = Literal[
    "stall", "bridge", "encoder_stuck", "encoder_reversed", "encoder_track_a", "encoder_track_b",
    "leak", "wire", "read_back_frozen", "valve_stuck",
    "tendon_cut", "cell_open", "cell_saturated", "cell_frozen",
]  # fmt: skip
BodyFault: TypeAlias = Literal["encoder_share", "encoder_jump"]
LineFault: TypeAlias = Literal["garbage", "mute", "supply_low"]
BoardEvent: TypeAlias = Literal["reset", "brown_out", "power_cycle", "freeze", "unplug", "plug"]
#: Distance of the emulated end stops beyond the travel.
_STOP_MARGIN_DEG: Final = 30.0
#: Signals of a program's own faults; others come from outside.
CRASHES: Final = (signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGSEGV)
#: Polling interval of the control file.
_FOLLOW_S: Final = 0.02


class BoardFault(Strict):
    """One fault switch, and its keys in a control file.

    Attributes:
        fault: fault of one channel, which ``silent`` takes off the board; of the line; or an event.
        channel: number of the channel, for faults of one.
        on: false ends a fault of a channel or of the line.
        value: of ``encoder_share``, the part of the motion of the shaft that its encoder sees (0.33: the horn
            slipped, -1: a wrong sign); of ``encoder_jump``, by how many counts it jumps.
        ms: duration of an event; without end if left out.
    """

    fault: ChannelFault | BodyFault | Literal["silent"] | LineFault | BoardEvent
    channel: int = Field(default=0, ge=0, lt=CHANNELS)
    on: bool = True
    value: float = 1.0
    ms: int | None = Field(default=None, ge=0)

    @property
    def command(self) -> str:
        """The line that switches it, as firmware/host/README.md has it."""
        if self.fault in get_args(ChannelFault):
            return f"set {self.channel} {self.fault} {self.on:d}"
        if self.fault in get_args(BodyFault):
            return f"set {self.channel} {self.fault} {self.value:.9g}"
        if self.fault == "silent":
            return f"silent {self.channel} {self.on:d}"
        if self.fault in get_args(LineFault):
            return f"{self.fault} {self.on:d}"
        return self.fault if self.ms is None else f"{self.fault} {self.ms}"


def plant_commands(axis: AxisOnBus, adc: Adc = DUE_ADC) -> list[str]:
    """Commands that set the plant of one channel to the values of the robot file."""
    options = axis_options(axis)
    channel = options.number
    numbers = _motor(axis, options, adc) if options.kind is DeviceKind.MOTOR else _regulator(options, adc)
    return [f"set {channel} {name} {value:.9g}" for name, value in numbers.items()]


def _motor(axis: AxisOnBus, o: DueAxisOptions, adc: Adc) -> dict[str, float]:
    per_deg = o.counts_per_rev / 360.0
    numbers = {
        "no_load": o.no_load_deg_s * per_deg,
        "tau": max(o.time_constant_ms, 1.0) / 1000.0,
        "friction": o.friction_percent / 100.0,
        "shaft": o.power_up_deg * per_deg,
        "full_scale_ma": o.current_ma_per_v * adc.mv / 1000.0,
        "wired_coast": o.start is SafeState.COAST,
        "motor_wired": o.motor_reversed,
        "encoder_wired": o.encoder_reversed,
        "stall_ma": o.stall_current_ma * 1.5 or 1600.0,
    }
    margin = _STOP_MARGIN_DEG * per_deg
    if axis.travel is not None:
        per_rad = o.counts_per_rev / math.tau
        numbers["low"] = axis.travel[0] * per_rad - margin
        numbers["high"] = axis.travel[1] * per_rad + margin
    if o.homing is not None:
        numbers["high" if o.homing.direction > 0 else "low"] = o.homing.at_deg * per_deg
    return numbers | ({} if o.tension is None else _tendon(o.tension, o, adc))


def _tendon(t: LoadCell, o: DueAxisOptions, adc: Adc) -> dict[str, float]:
    """A body that stands; where the shaft powers up the tendon has three times its floor."""
    (low, low_n), (high, high_n) = t.readings
    per_deg = o.counts_per_rev / 360.0
    per_reading = adc.steps / adc.mv if t.cell == "amplifier" else 1.0
    steps_per_n = (high - low) / (high_n - low_n) * per_reading
    return {
        "tendon": t.stiffness_n_per_deg / per_deg * 1000.0,
        "tendon_slack_at": (o.power_up_deg - t.tightens * 3.0 * t.floor_n / t.stiffness_n_per_deg) * per_deg,
        "tendon_pull": t.tightens,
        "cell_zero": low * per_reading - low_n * steps_per_n,
        "cell_steps": steps_per_n / 1000.0,
        "cell_period": 1.0 if t.cell == "amplifier" else max(1.0, 1000.0 // t.rate_hz),
    }


def _regulator(o: DueAxisOptions, adc: Adc) -> dict[str, float]:
    assert o.readback is not None
    assert o.ceiling_bar is not None
    (low_mv, low_bar), (high_mv, high_bar) = o.readback
    if o.valves is not None:
        # A pump of half as much again; a reading that lags as the robot file states.
        source = {
            "full_pa": 0.0,
            "outlet_open": o.valves.outlet == "normally_open",
            "supply": 1.5 * o.ceiling_bar * BAR,
            "lag": o.lag_ms / 1000.0,
            "opens": 0.6 * o.valves.valve_ms / 1000.0,
            "shuts": 0.4 * o.valves.valve_ms / 1000.0,
        }
    else:
        assert o.calibration is not None
        (first_duty, first_bar), (last_duty, last_bar) = o.calibration[0], o.calibration[-1]
        source = {"full_pa": (last_bar - first_bar) / (last_duty - first_duty) * 100.0 * BAR}
    return source | {
        "raw_low": low_mv / adc.mv * adc.steps,
        "low_pa": low_bar * BAR,
        "raw_high": high_mv / adc.mv * adc.steps,
        "high_pa": high_bar * BAR,
    }


class DueEmulator:
    """One emulated board; a context manager."""

    def __init__(
        self,
        options: DueBusOptions,
        axes: Sequence[AxisOnBus],
        journal: Path | None = None,
        adc: Adc = DUE_ADC,
        parts: Sequence[str] = (),
    ) -> None:
        """``adc`` and ``parts`` (arguments of firmware/host) make it another board than a Due."""
        self.port = Path(options.port)
        self._lock = threading.Lock()
        self._command = [str(build_host()), options.role.value, "--pty", options.port]
        self._command += ["--adc", str(adc.steps), f"{adc.mv:.0f}", *parts]
        if journal is not None:
            self._command += ["--journal", str(journal)]
        if options.connection == "programming":
            self._command.append("--reset-on-open")
        for axis in axes:
            for line in plant_commands(axis, adc):
                self._command += ["--world", line]

    def __enter__(self) -> Self:
        """Start the board; it answers on return."""
        try:
            self.port.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise self._port_error() from error
        self._process = subprocess.Popen(
            self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        assert self._process.stdout is not None
        if self._process.stdout.readline().strip() != "ready":
            self._end()
            raise self._port_error()
        return self

    def _port_error(self) -> DeviceError:
        remedy = "run it where you may write, or name another port"
        return DeviceError("due emulator", f"cannot make a pty at {self.port}", remedy)

    def __exit__(self, *_: object) -> None:
        """End the board and remove its link.

        Raises:
            DeviceError: the firmware crashed, which its host saw as a lost port.
        """
        code = self._end()
        if -code in CRASHES:
            fault = signal.Signals(-code).name
            why = f"the firmware of the emulated board at {self.port} crashed with {fault}"
            raise DeviceError("due emulator", why, "please report it")

    def _end(self) -> int:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        self._process.stdout.close()
        return self._process.wait(timeout=10)

    def command(self, line: str) -> str:
        """Send one command of firmware/host/README.md; return its answer.

        Raises:
            DeviceError: there is no such command, or the board has ended.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with self._lock:
            try:
                self._process.stdin.write(line + "\n")
                self._process.stdin.flush()
                answer = self._process.stdout.readline().strip()
            except BrokenPipeError:
                answer = ""
        if not answer:
            raise DeviceError("due emulator", f"the emulated board at {self.port} has ended")
        if not answer.startswith("ok"):
            raise DeviceError("due emulator", f"unknown command {line!r}")
        return answer[3:]

    def switch(self, given: object) -> None:
        """Set a fault switch (see `BoardFault`)."""
        self.command(BoardFault.model_validate(given).command)


def _follow(control: ControlFile, ended: threading.Event) -> None:
    while not ended.wait(_FOLLOW_S):
        control.poll()


class BoardBench:
    """Context manager that serves the board of one bus at the port of its options (`contid.hal.Emulates`)."""

    def __init__(
        self, name: str, options: DueBusOptions, axes: Sequence[AxisOnBus], control: Path | None
    ) -> None:
        self._name, self._options, self._axes = name, options, axes
        self.emulator = DueEmulator(options, axes)
        self._control = None if control is None else ControlFile(control, self.emulator.switch)
        self._stack = contextlib.ExitStack()

    def __enter__(self) -> Sequence[str]:
        """Start; returns a description of the bus."""
        path = Path(self._options.port)
        if path.exists() and path.is_char_device() and not path.is_symlink():
            raise DeviceError(self._name, f"{path} is a real device", "name a path that does not exist yet")
        self._stack.enter_context(self.emulator)
        if self._control is not None:
            ended = threading.Event()
            follower = threading.Thread(target=_follow, args=(self._control, ended), daemon=True)
            follower.start()
            self._stack.callback(follower.join)
            self._stack.callback(ended.set)
        channels = ", ".join(f"{axis_options(axis).channel} {axis.name}" for axis in self._axes)
        return [f"{self._name}: {self._options.role} board at {self._options.port}: {channels}"]

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def actuators(self, now_s: float) -> dict[str, float]:
        """Where shafts [rad] and pressures [Pa] are; the board's own clock has moved them."""
        found = {}
        for axis in self._axes:
            options = axis_options(axis)
            shaft, _, pressure, *_ = self.emulator.command(f"get {options.number}").split()
            motor = options.kind is DeviceKind.MOTOR
            found[axis.name] = float(shaft) * math.tau / options.counts_per_rev if motor else float(pressure)
        return found


def emulate(
    name: str, options: DueBusOptions, axes: Sequence[AxisOnBus], control: Path | None = None
) -> BoardBench:
    """Emulate the board of one bus (`contid.hal.Emulates`)."""
    return BoardBench(name, options, axes, control)
