"""The recordings of a folder, from their heads and their indexes alone: no tick is read."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from mcap.exceptions import McapError
from mcap.reader import SeekingReader

from contid.errors import SessionError
from contid.session.read import Session


@dataclass(frozen=True, slots=True)
class ListedRecording:
    """One file.

    Attributes:
        file: its path.
        began: UTC, ISO 8601; "" where its head cannot be read.
        duration_s: from its first message to its last [s]; None without an index.
        bytes: its size.
        robot_file: name of the robot file.
        robots: names of its robots.
        state: ``whole``, ``cut off``, or why it cannot be read.
    """

    file: str
    began: str
    duration_s: float | None
    bytes: int
    robot_file: str
    robots: tuple[str, ...]
    state: str

    def __str__(self) -> str:
        """One line."""
        lasts = "-" if self.duration_s is None else f"{self.duration_s:.1f} s"
        began = self.began[:19].replace("T", " ") or "-"
        what = f"{self.robot_file}: {', '.join(self.robots)}" if self.robots else self.state
        note = "" if self.state == "whole" or not self.robots else f"  ({self.state})"
        return f"{began:19}  {lasts:>9}  {self.bytes / 1e6:7.2f} MB  {Path(self.file).name}  {what}{note}"


def recordings_in(folder: Path) -> list[ListedRecording]:
    """The MCAP files of a folder, the newest first; one that vanishes meanwhile is left out.

    Raises:
        SessionError: there is no such folder, or it cannot be read.
    """
    try:
        files = sorted(path for path in folder.iterdir() if path.suffix == ".mcap" and path.is_file())
    except OSError as error:
        raise SessionError(f"{folder}: cannot list it: {error.strerror}") from error
    found = []
    for path in files:
        with suppress(FileNotFoundError):
            found.append(listed(path))
    return sorted(found, key=lambda each: each.began, reverse=True)


def listed(path: Path) -> ListedRecording:
    """One recording; what cannot be read has the reason as its state.

    Raises:
        OSError: there is no such file.
    """
    size = path.stat().st_size
    try:
        session = Session(path)
    except SessionError as error:
        return ListedRecording(str(path), "", None, size, "", (), str(error).removeprefix(f"{path}: "))
    duration_s = _duration_s(path)
    return ListedRecording(
        file=str(path),
        began=session.metadata["contid"].get("created", ""),
        duration_s=duration_s,
        bytes=size,
        robot_file=Path(session.metadata.get("robot_file", {}).get("name", "")).stem,
        robots=tuple(session.robots),
        state="cut off; `contid session repair` completes it" if duration_s is None else "whole",
    )


def _duration_s(path: Path) -> float | None:
    """From the statistics at the end of a file; None where it has no end."""
    try:
        with path.open("rb") as file:
            summary = SeekingReader(file).get_summary()
    except (McapError, OSError, ValueError):
        return None
    found = None if summary is None else summary.statistics
    return None if found is None else (found.message_end_time - found.message_start_time) / 1e9
