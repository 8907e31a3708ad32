"""Reading a session, whole or cut off at any byte: its head, then ticks and events in their order."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from contid.control.engine.tick_layout import RecordLayout, TickRecord
from contid.errors import BadInputError, ContidError
from contid.robot_file.load import LoadedFile, parse_robot_file, with_mock
from contid.session.format import mcap_records as mcap
from contid.session.format.channels import CHANNELS
from contid.session.format.decode import Decoder
from contid.session.format.entries import EndOfFile, Entry, read_entries
from contid.session.format.mcap_records import DamagedRecordError, RecordStream
from contid.session.format.metadata import FORMAT, TRAJECTORY, unpacked
from contid.trajectory.timed import Trajectory


class SessionError(ContidError):
    """A file is no session, or one that this version cannot use."""


class Session:
    """One file.

    Attributes:
        path: of the file.
        about: texts by group and name, as `contid.session.format.metadata` writes them.
        layout: of the records.
        device_units: ``rad`` or ``pa`` by ``ROBOT.AXIS``.
        rate_hz: of the ticks.
    """

    def __init__(self, path: Path, progress: Callable[[int], None] = lambda ticks: None) -> None:
        """Read the head.

        Args:
            path: of the file.
            progress: called with the number of ticks now and then, while `entries` reads.

        Raises:
            SessionError: the file is no session, or its head is cut off.
        """
        self.path = path
        self._progress = progress
        self.about: dict[str, dict[str, str]] = {}
        self._end = EndOfFile()
        self._attachments: dict[str, bytes] = {}
        self._topics: dict[int, str] = {}
        if path.exists() and not path.is_file():
            raise SessionError(f"{path}: not a file that can be read twice, as a session is")
        try:
            with path.open("rb") as file:
                if (begin := file.read(len(mcap.MAGIC))) != mcap.MAGIC:
                    raise SessionError(f"{path}: {'not an MCAP file' if begin else 'empty'}")
                file.seek(0)
                begun = self._read_head(RecordStream(file))
        except OSError as error:
            raise SessionError(f"{path}: cannot read it: {error.strerror}") from error
        except DamagedRecordError as error:
            raise SessionError(f"{path}: its head is damaged: {error}") from error
        version = self.about.get("contid", {}).get("format")
        known = set(self._topics.values()) & {*CHANNELS}
        if version is None or not (begun or len(known) == len(CHANNELS)):
            message = "; `mcap filter` keeps its metadata with --include-metadata" if begun and known else ""
            raise SessionError(f"{path}: not a session of contid, or cut off before its first tick{message}")
        if version != FORMAT:
            raise SessionError(f"{path}: format {version}; this contid reads format {FORMAT}")
        try:
            self.layout = RecordLayout.from_json(self.about["layout"]["record"])
            self.device_units: dict[str, str] = json.loads(self.about["layout"]["device_units"])
            # Whatever follows needs these to fit each other.
            Decoder(self.layout, self.device_units)
            int(self.about["clock"]["wall_ns"])
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise SessionError(f"{path}: its head is damaged: {type(error).__name__}: {error}") from error
        self.rate_hz = self.layout.rate_hz

    def _read_head(self, stream: RecordStream) -> bool:
        """Everything before the first message; True when there is one."""
        for opcode, body in stream:
            if opcode == mcap.MESSAGE:
                return True
            self._keep(opcode, body)
        return False

    def _keep(self, opcode: int, body: bytes) -> None:
        """Take a record that is no message.

        Trajectories may come between messages; in files that other programs rewrote, channels as well.
        """
        if opcode not in (mcap.METADATA, mcap.ATTACHMENT, mcap.CHANNEL):
            return
        record = mcap.understood(opcode, body)
        if opcode == mcap.METADATA:
            self.about[record.name] = dict(record.metadata)
        elif opcode == mcap.ATTACHMENT:
            self._attachments[record.name] = record.data
        else:
            self._topics[record.id] = record.topic

    def option(self, name: str) -> str:
        """What the run was asked for; "" when it was not said."""
        return self.about.get("options", {}).get(name, "")

    @property
    def clean(self) -> bool:
        """After `entries` came to the end: the file ends as it should."""
        return self._end.clean

    @property
    def chunked(self) -> bool:
        """The same: it was compacted."""
        return self._end.chunked

    @property
    def cut(self) -> str:
        """The same: what was found where it ends before its end, "" when it is clean."""
        return self._end.cut

    @property
    def virtual(self) -> bool:
        """True for a run in virtual time."""
        return self.option("virtual") == "true"

    @property
    def robot_text(self) -> str:
        """The text of the robot file.

        Raises:
            SessionError: it holds none.
        """
        text = self.about.get("robot_file", {}).get("text")
        if text is None:
            raise SessionError(f"{self.path}: it holds no robot file")
        return text

    def robot_file(self, wired: bool = False) -> LoadedFile:
        """The robot file of the run, its buses simulated when they were so.

        Args:
            wired: its own buses, even when they were simulated.

        Raises:
            SessionError: today's contid does not take it any more.
        """
        text, name = self.robot_text, self.about["robot_file"].get("name", "robot_file")
        try:
            loaded = parse_robot_file(text, name, recorded=True)
        except BadInputError as error:
            message = "its robot file is refused today; export it with --yaml, mend it, give it with --robot"
            raise SessionError(f"{self.path}: {message}. In the recorded text:\n{error}") from error
        return with_mock(loaded) if self.option("mock") == "True" and not wired else loaded

    def trajectory(self, loaded: LoadedFile, played: int = 0) -> Trajectory | None:
        """A timed trajectory, bit for bit; None when there is none.

        Args:
            loaded: whose columns they are.
            played: 0 for the one the run began with; n for the n-th that came later, once `entries` is there.
        """
        name = f"{TRAJECTORY}-{played}" if played else TRAJECTORY
        about = self.about.get(name)
        if about is None:
            return None
        if f"{name}.npz" not in self._attachments:
            message = "`mcap filter` keeps it with --include-attachments, if its time is kept"
            raise SessionError(f"{self.path}: its {name}.npz is missing; {message}")
        if not about.keys() >= {"columns", "sha256", "interpolation"}:
            raise SessionError(f"{self.path}: its trajectory has no columns")
        return unpacked(self._attachments[f"{name}.npz"], about, loaded)

    def entries(self) -> Iterator[Entry]:
        """Ticks and events in their order; a tick that is not whole is left out."""
        decoder = Decoder(self.layout, self.device_units)
        self._end = yield from read_entries(self.path, self._topics, decoder, self._keep, self._progress)

    def ticks(self) -> Iterator[TickRecord]:
        """Records of the ticks."""
        for entry in self.entries():
            if entry.values is not None:
                yield self.layout.decode(tuple(entry.values))

    def events(self) -> Iterator[Mapping[str, Any]]:
        """Events alone."""
        for entry in self.entries():
            if entry.event is not None:
                yield entry.event
