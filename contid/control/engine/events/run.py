"""How a run begins and ends, and what is written beside it: log records and notes of clients."""

from __future__ import annotations

from typing import Annotated

from contid.control.engine.events import RunEvent, Text, TickNumber, run_event


@run_event("started")
class RunStarted(RunEvent):
    """The buses are open; the message is the reason when real-time priority was refused."""

    realtime: Annotated[bool, "the control process has real-time priority"]
    message: Text


@run_event("failed")
class RunFailed(RunEvent):
    """The control process cannot continue."""

    message: Text
    exit_code: Annotated[int, "of the process"]


@run_event("end")
class SourceEnded(RunEvent):
    """The trajectory or the stream ended."""

    tick: TickNumber
    on_end: Annotated[str, "what the robots do then"]


@run_event("stream")
class StreamDelayed(RunEvent):
    """The delay that a live stream is followed with changed (`contid.control.engine.live.row_clock`)."""

    tick: TickNumber
    delay_ms: Annotated[float, "from when a row is due, as learnt, until it is followed [ms]; 0: not learnt"]


@run_event("stopping")
class StopBegan(RunEvent):
    """All robots stop; the run ends afterwards."""

    reason: Annotated[str, "why the stop began"]
    seconds: Annotated[float, "how long the stop takes"]


@run_event("log")
class LogWritten(RunEvent):
    """A log record of the daemon or of the control process."""

    process: Annotated[str, "daemon or control"]
    level: Annotated[str, "debug, info, warning, error or critical"]
    logger: Annotated[str, "name of the module"]
    message: Text


@run_event("note")
class NoteWritten(RunEvent):
    """A client related the clock of this run to its own, for recordings that are laid over each other."""

    experiment: Annotated[str, "name of the experiment"]
    node: Annotated[str, "name of this daemon in its fleet"]
    conductor: Annotated[str, "machine that conducts the fleet run, by its boot, where its clock began"]
    at_s: Annotated[float, "when the offset was measured, on the clock of the buses"]
    offset_s: Annotated[float, "clock of the buses, that of ``deadline_s``, less that of the client"]
    bound_s: Annotated[float, "largest error of the offset"]
    wall_s: Annotated[float, "time of day less the clock of the client"]
    message: Text = ""
