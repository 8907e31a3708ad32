"""Reading a session, complete or truncated at any byte: its head, then ticks and events in their order.

`Session` is public as ``contid.Session``: `robots`, iteration, `events`, `to_pandas`, `robot_file` and the
attributes `path` and `rate_hz` are stable.
"""

from __future__ import annotations

import json
import stat
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from contid.control.engine.events import RunEvent
from contid.control.engine.tick_layout import RecordLayout, RobotLayout, TickRecord
from contid.control.tick.config import MOTION_RULES
from contid.entry_points import RECORDINGS, required
from contid.errors import BadInputError, SessionError
from contid.html import html_table
from contid.robot_file.load import LoadedFile, parse_robot_file, with_mock
from contid.session.format import mcap_records as mcap
from contid.session.format.channels import CHANNELS, REVISION
from contid.session.format.decode import Decoder
from contid.session.format.entries import EndOfFile, Entry, read_entries
from contid.session.format.mcap_records import DamagedRecordError
from contid.session.format.metadata import FORMAT, TRAJECTORY, decode_trajectory
from contid.session.format.record_stream import RecordStream
from contid.trajectory.timed import Trajectory

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class Session:
    """One file. Iteration gives every tick as values by column, in the units of robot files.

    Attributes:
        path: path of the file.
        metadata: texts by group and name, written by `contid.session.format.metadata`.
        layout: layout of the records.
        device_units: ``rad`` or ``pa`` by ``ROBOT.AXIS``.
        rate_hz: rate of the ticks.
        motion_rules: version of the rules of motions (`contid.control.tick.config.MOTION_RULES`).
        end: how the file ends, after `entries` is exhausted.
    """

    def __init__(self, path: str | Path, progress: Callable[[int], None] = lambda ticks: None) -> None:
        """Read the head.

        Args:
            path: path of the file.
            progress: called from time to time with the number of ticks that `entries` has read.

        Raises:
            SessionError: the file is not a session, or its head is incomplete.
        """
        self.path = path = Path(path)
        self._progress = progress
        self.metadata: dict[str, dict[str, str]] = {}
        self.end = EndOfFile()
        self._attachments: dict[str, bytes] = {}
        self._topics: dict[int, str] = {}
        try:
            # Opening a pipe would wait for its writer.
            if not stat.S_ISREG(path.stat().st_mode):
                raise SessionError(f"{path}: not a regular file")
            with path.open("rb") as file:
                if (begin := file.read(len(mcap.MAGIC))) != mcap.MAGIC:
                    raise SessionError(f"{path}: {'not an MCAP file' if begin else 'empty'}")
                file.seek(0)
                has_message = self._read_head(RecordStream(file))
        except OSError as error:
            raise SessionError(f"{path}: cannot read it: {error.strerror}") from error
        except DamagedRecordError as error:
            raise SessionError(f"{path}: its head is damaged: {error}") from error
        if "merged" in self.metadata:
            raise SessionError(
                f"{path}: merged from several sessions, for looking at; give one of the originals"
            )
        version = self.metadata.get("contid", {}).get("format")
        channels = set(self._topics.values()) & {*CHANNELS}
        if version is None or not (has_message or len(channels) == len(CHANNELS)):
            filtered = has_message and channels
            message = "; `mcap filter` keeps its metadata with --include-metadata" if filtered else ""
            raise SessionError(f"{path}: not a session of contid, or cut off before its first tick{message}")
        if version != FORMAT:
            raise SessionError(f"{path}: format {version}; this contid reads format {FORMAT}")
        try:
            if (revision := int(self.metadata["contid"].get("revision", "0"))) > REVISION:
                raise SessionError(
                    f"{path}: revision {revision} of the messages; this contid reads revisions 0 to "
                    f"{REVISION}: update contid"
                )
            self.motion_rules = int(self.metadata["contid"].get("motion_rules", "0"))
            if not 0 <= self.motion_rules <= MOTION_RULES:
                raise SessionError(
                    f"{path}: motion rules {self.motion_rules}; this contid replays rules 0 to "
                    f"{MOTION_RULES}: update contid"
                )
            self.layout = RecordLayout.from_json(self.metadata["layout"]["record"])
            self.device_units: dict[str, str] = json.loads(self.metadata["layout"]["device_units"])
            # Refuses layouts and units that do not fit each other.
            Decoder(self.layout, self.device_units)
            int(self.metadata["clock"]["wall_ns"])
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise SessionError(f"{path}: its head is damaged: {type(error).__name__}: {error}") from error
        self.rate_hz = self.layout.rate_hz

    def _read_head(self, stream: RecordStream) -> bool:
        """Read everything before the first message; True if there is one."""
        for opcode, body in stream:
            if opcode == mcap.MESSAGE:
                return True
            self._keep(opcode, body)
        return False

    def _keep(self, opcode: int, body: bytes) -> None:
        """Keep a record that is not a message.

        Trajectories may occur between messages; in files that other programs rewrote, channels as well.
        """
        if opcode not in (mcap.METADATA, mcap.ATTACHMENT, mcap.CHANNEL):
            return
        record = mcap.decode(opcode, body)
        if opcode == mcap.METADATA:
            self.metadata[record.name] = dict(record.metadata)
        elif opcode == mcap.ATTACHMENT:
            self._attachments[record.name] = record.data
        else:
            self._topics[record.id] = record.topic

    @property
    def robots(self) -> Mapping[str, RobotLayout]:
        """Model, unit of the axes (``mm`` or ``bar``) and names of the axes, by robot."""
        return {robot.name: robot for robot in self.layout.robots}

    def __iter__(self) -> Iterator[dict[str, float]]:
        """Every tick, by the columns of `to_pandas`; what is absent is NaN."""
        rows: Iterator[dict[str, float]] = _of_extra("row_values")(self)
        return rows

    def to_pandas(self) -> pd.DataFrame:
        """All ticks with the columns of ``contid session export --csv``; the index is ``t_s``.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        frame: pd.DataFrame = _of_extra("data_frame")(self)
        return frame

    def plot(self) -> Figure:
        """Commands and measured values of every axis over time, one diagram per robot, by matplotlib.

        Raises:
            MissingExtraError: matplotlib is not installed.
        """
        figure: Figure = _of_extra("plot")(self)
        return figure

    def _repr_html_(self) -> str:
        time = "virtual" if self.virtual else "real"
        rows = [(name, robot.model, ", ".join(robot.axes)) for name, robot in self.robots.items()]
        caption = f"{self.path}: {self.rate_hz:g} Hz in {time} time"
        return html_table(caption, ("robot", "model", "axes"), rows)

    def option(self, name: str) -> str:
        """An option of the run; "" if it was not given."""
        return self.metadata.get("options", {}).get(name, "")

    @property
    def virtual(self) -> bool:
        """True for a run in virtual time."""
        return self.option("virtual") == "true"

    @property
    def robot_text(self) -> str:
        """The text of the robot file.

        Raises:
            SessionError: the session has none.
        """
        text = self.metadata.get("robot_file", {}).get("text")
        if text is None:
            raise SessionError(f"{self.path}: has no robot file")
        return text

    def robot_file(self, real_buses: bool = False) -> LoadedFile:
        """The robot file of the run, with simulated buses if they were simulated.

        Args:
            real_buses: its own buses, even if they were simulated.

        Raises:
            SessionError: this version of contid refuses it.
        """
        text, name = self.robot_text, self.metadata["robot_file"].get("name", "robot_file")
        try:
            loaded = parse_robot_file(text, name, recorded=True)
        except BadInputError as error:
            message = "its robot file is refused; export it with --yaml, correct it, give it with --robot"
            raise SessionError(f"{self.path}: {message}. In the recorded text:\n{error}") from error
        return with_mock(loaded) if self.option("mock") == "True" and not real_buses else loaded

    def trajectory(self, loaded: LoadedFile, played: int = 0) -> Trajectory | None:
        """A timed trajectory, bit for bit; None when there is none.

        Args:
            loaded: the robot file with its columns.
            played: 0 for the one the run started with; n for the n-th order to play one, once `entries` has
                read it.
        """
        name = f"{TRAJECTORY}-{played}" if played else TRAJECTORY
        metadata = self.metadata.get(name)
        if metadata is None:
            return None
        if f"{name}.npz" not in self._attachments:
            message = "`mcap filter` keeps it with --include-attachments, if its time is kept"
            raise SessionError(f"{self.path}: its {name}.npz is missing; {message}")
        if not metadata.keys() >= {"columns", "sha256", "interpolation"}:
            raise SessionError(f"{self.path}: its trajectory has no columns")
        return decode_trajectory(self._attachments[f"{name}.npz"], metadata, loaded)

    def entries(self) -> Iterator[Entry]:
        """Ticks and events in their order without incomplete ticks."""
        decoder = Decoder(self.layout, self.device_units)
        self.end = yield from read_entries(self.path, self._topics, decoder, self._keep, self._progress)

    def ticks(self) -> Iterator[TickRecord]:
        """Records of the ticks."""
        for entry in self.entries():
            if entry.values is not None:
                yield self.layout.decode(tuple(entry.values))

    def events(self) -> Iterator[RunEvent]:
        """The events."""
        for entry in self.entries():
            if entry.event is not None:
                yield entry.event


def _of_extra(name: str) -> Any:
    """A function over the ticks of a session as a table, of the extra `sessions`."""
    return required(RECORDINGS, name, f"the table of a session ({name})", "sessions")
