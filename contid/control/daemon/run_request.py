"""The options of one run, and the robot file and input they name, read and checked."""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from contid import kernels
from contid.control.daemon.check_trajectory import with_remedy
from contid.control.daemon.inputs import CancellableReader, Stream, has_input, read_file, read_stdin
from contid.control.daemon.interfaces import CommandSource, RunObserver
from contid.control.daemon.pending_input import PendingInput
from contid.control.daemon.terminal import check_progress, print_message
from contid.control.engine.cycle import OnEnd
from contid.control.engine.wiring import build_preflight
from contid.control.process.other_devices import with_other_devices
from contid.control.tick.preflight.rows import Preflight, TooFastError, Unreachable
from contid.entry_points import STRETCHES, required
from contid.errors import ContidError
from contid.robot_file.document import MAX_RATE_HZ
from contid.robot_file.load import LoadedFile, load_named, with_mock
from contid.robot_file.needs import require_extras
from contid.robot_file.summary import feedback_line
from contid.robot_file.tick_rate import rate_too_high, watchdog_too_short
from contid.trajectory.timed import Trajectory, whole_turns


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """Options of a run with a given robot file and input.

    Attributes:
        rate_hz: ticks per second, instead of the file's.
        on_end: what to do when the input ends.
        unreachable: what to do with unreachable targets.
        log: path of the command log.
        armed: arm at once; False to connect and wait for `resume`.
        commands: sources of commands besides the input, such as the socket.
        observers: readers of the ring.
        log_level: lowest level of log records on the terminal.
    """

    rate_hz: float | None = None
    on_end: OnEnd = OnEnd.STOP
    unreachable: Unreachable = Unreachable.REFUSE
    log: Path | None = None
    armed: bool = True
    commands: Sequence[CommandSource] = ()
    observers: Sequence[RunObserver] = ()
    log_level: int = logging.INFO


@dataclass(frozen=True, slots=True)
class RunRequest(RunOptions):
    """The options of `contid run`.

    Attributes:
        robot_file: path, or name of a shipped file.
        mock: simulated devices.
        trajectory: file of timed rows; None for stdin.
        virtual: in virtual time.
        stretch: slow a trajectory down that is too fast, as little as needed.
    """

    robot_file: str
    mock: bool = False
    trajectory: str | None = None
    virtual: bool = False
    stretch: bool = False


def load(request: RunRequest) -> LoadedFile:
    """Load and check the robot file.

    Raises:
        ContidError: it is wrong, its tip feedback is unstable, it needs an extra that is not installed, or
            the kernels are not compiled.
    """
    kernels.require()
    loaded = load_named(request.robot_file)
    require_extras(loaded)
    for name in loaded.driven:
        feedback_line(loaded, name)
    if request.rate_hz is not None:
        if not 0.0 < request.rate_hz <= MAX_RATE_HZ:
            allowed = f"above 0, at most {MAX_RATE_HZ:g}, as rate_hz in a robot file"
            raise ContidError(f"--rate: {request.rate_hz:g}; allowed: {allowed}")
        for message in watchdog_too_short(loaded.buses.values(), request.rate_hz):
            raise ContidError(f"--rate: {message}")
    if request.mock:
        return with_mock(loaded)
    if request.rate_hz is not None:
        for message in rate_too_high(loaded.buses.values(), request.rate_hz):
            raise ContidError(f"--rate: {message}")
    return with_other_devices(loaded)


def rate_of(options: RunOptions, loaded: LoadedFile) -> float:
    """Ticks per second: of the options, else of the file."""
    return options.rate_hz or loaded.file.rate_hz


def preflight_of(options: RunOptions, loaded: LoadedFile) -> Preflight | None:
    """The check for rows of the input, None when every row passes."""
    return build_preflight(loaded, rate_of(options, loaded), options.unreachable)


def read_input(
    request: RunRequest, loaded: LoadedFile, reader: CancellableReader
) -> Trajectory | Stream | None:
    """Wait for the input and check it; None without one.

    Raises:
        ContidError: it is wrong, or empty.
        InputCancelledError: the reader was cancelled.
    """
    robots = loaded.driven
    source: Trajectory | Stream
    if request.trajectory is not None:
        source = read_file(request.trajectory, robots)
    elif has_input(sys.stdin):
        source = read_stdin(sys.stdin, robots, reader)
    else:
        return None
    if not isinstance(source, Trajectory):
        if request.stretch:
            raise ContidError("--stretch: rows of a live stream have no times to stretch")
        return source
    preflight = preflight_of(request, loaded)
    return source if preflight is None else _checked(request, source, preflight, reader)


def _checked(
    request: RunRequest, source: Trajectory, preflight: Preflight, reader: CancellableReader
) -> Trajectory:
    """The trajectory that will be followed: the one that was read, or with ``stretch`` a slower one."""
    show = check_progress(len(source))
    for note in whole_turns(source, request.trajectory or "stdin"):
        print_message(note)

    def progress(done: int, total: int) -> None:
        reader.check()
        show(done, total)

    try:
        return preflight.trajectory(source, request.trajectory or "stdin", progress)
    except TooFastError as error:
        if not request.stretch:
            raise with_remedy(error, source) from error
        least = required(STRETCHES, "least", "--stretch", "paths")
        factor: float = least(source, preflight, error, reader.check)
        slower = source.stretched(factor)
        if request.log_level <= logging.INFO:
            before_s, now_s = (each.end_s - each.start_s for each in (source, slower))
            print_message(f"too fast: stretched {factor:.4g} times, from {before_s:.4g} s to {now_s:.4g} s")
        return slower.accepted()


def open_input(request: RunRequest, loaded: LoadedFile) -> PendingInput | None:
    """The input of a run in real time, not yet read; None without one."""
    if request.trajectory is None and not has_input(sys.stdin):
        if sys.stdin is not None and sys.stdin.isatty() and request.log_level <= logging.INFO:
            print_message(
                "no trajectory: the robots hold; contid move, jog or panel moves them, Ctrl-C ends the run"
            )
        return None
    message = "waiting for a trajectory on stdin" if request.trajectory is None else "checking the trajectory"
    return PendingInput(message, lambda reader: read_input(request, loaded, reader))
