"""Live targets: one line at a time, the newest row is the target."""

from __future__ import annotations

from collections.abc import Mapping

from contid.robot_file.robot import RobotDescription
from contid.targets import Target
from contid.trajectory.rows import RowReader, is_comment


class StreamParser:
    """Parses the lines of a live stream, CSV or NDJSON.

    With NDJSON the first line is a row itself: give it to `parse` too. A column ``t_s`` is allowed and only
    checked to be a number; `timed` tells that the source has one.

    Raises:
        BadInputError: from the constructor, when the header is wrong.
    """

    def __init__(
        self, header: str, name: str, robots: Mapping[str, RobotDescription], number: int = 1
    ) -> None:
        self._reader = RowReader(header.rstrip("\r\n").removeprefix("\ufeff"), number, name, robots)

    @property
    def first_line_is_row(self) -> bool:
        """True for NDJSON, where the header line is the first row too."""
        return self._reader.is_json

    @property
    def timed(self) -> bool:
        """True when there is a column ``t_s``: then this is a trajectory, not a live stream."""
        return self._reader.layout.time is not None

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns as written."""
        return self._reader.layout.names

    @property
    def robots(self) -> tuple[str, ...]:
        """Robots that have columns."""
        return tuple(columns.robot for columns in self._reader.layout.robots)

    def parse(self, line: str, number: int) -> Mapping[str, Target] | None:
        """Targets by robot in the world frame, or None for a comment or blank line.

        Raises:
            BadInputError: this line is wrong; the next one can be parsed all the same.
        """
        line = line.rstrip("\r\n")
        if is_comment(line):
            return None
        return self._reader.layout.targets(self._reader.row(line, number))
