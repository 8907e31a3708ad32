"""The conditions of a move: rows that can be read, armed robots without a fault, targets within reach."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

from contid.control.daemon.interfaces import RunControl
from contid.control.engine.tick_layout import TickRecord
from contid.control.engine.wiring import chain_guards, clearance_of
from contid.control.tick.preflight.rows import Preflight, Unreachable
from contid.control.tick.supervisor import ARMED
from contid.errors import BadInputError
from contid.remote.protocol.wire import Code, RemoteError, is_number
from contid.remote.server.telemetry_view import TelemetryView
from contid.targets import Target
from contid.trajectory.columns import MAX_FINDINGS
from contid.trajectory.read import trajectory_of_rows
from contid.trajectory.rows import RowReader
from contid.trajectory.timed import Trajectory

#: Columns of a move. A laboratory of sixteen fingers has 200; thousands would hold up the other clients.
MAX_COLUMNS: Final = 500


class Preconditions:
    """Checks moves against the newest record and the models.

    Attributes:
        refuses: targets out of reach are refused; else the tick brings them within.
    """

    def __init__(self, control: RunControl, view: TelemetryView) -> None:
        self._control = control
        self._view = view
        self._guards = chain_guards(control.loaded)
        self._clearance = clearance_of(control.loaded)
        self.refuses = control.unreachable is Unreachable.REFUSE or bool(self._guards)

    def reader(self, columns: Collection[str], called: str) -> RowReader:
        """The reader of rows with these columns, whose messages name them ``called``.

        Raises:
            RemoteError: a column is none of the robots, or there are too many.
        """
        if len(columns) > MAX_COLUMNS:
            message = f"{len(columns)} columns; a move has at most {MAX_COLUMNS}"
            raise RemoteError(Code.BAD_TARGET, message)
        if any("," in name or "\n" in name or name.startswith(("{", "#")) for name in columns):
            raise RemoteError(Code.BAD_TARGET, "a column is one name, such as x_mm or left.x_mm")
        try:
            return RowReader(",".join(columns), called, self._view.robots)
        except BadInputError as error:
            raise _bad_target(error) from None

    def point(self, target: Mapping[str, Any]) -> dict[str, Target]:
        """The targets of robots, by the values of columns.

        Raises:
            RemoteError: a column or a value is wrong.
        """
        reader = self.reader(target, "move")
        for name, value in target.items():
            if not is_number(value):
                raise RemoteError(Code.BAD_TARGET, f"{name[:60]}: {str(value)[:40]!r} is not a number")
        if reader.timed:
            raise RemoteError(Code.BAD_TARGET, "a point has no time; stream rows with columns for that")
        try:
            return reader.layout.targets(reader.row(tuple(target.values()), 1))
        except BadInputError as error:
            raise _bad_target(error) from None

    def armed(self, robots: Sequence[str]) -> None:
        """Refuse robots that would not follow a target.

        Raises:
            RemoteError: one is in FAULT, or not armed.
        """
        record = self._control.newest()
        faults = self._view.faults(record, robots)
        if faults:
            found = "; ".join(f"{name}: fault {f['number']} {f['name']}" for name, f in faults.items())
            raise RemoteError(Code.FAULT, f"{found}; clear-fault, then resume", faults)
        for name in robots:
            mode = self._view.mode(name, record)
            if mode not in ARMED:
                raise RemoteError(Code.NOT_ARMED, f"{name} is {mode.name}, not armed; resume first")

    def asked(self, robots: Collection[str]) -> Collection[str]:
        """The robots whose models a check of some asks: what keeps bodies apart asks all."""
        return robots if self._clearance is None else self._view.configs

    def unreachable(self, targets: Mapping[str, Target | None], record: TickRecord | None) -> dict[str, str]:
        """Robots that cannot reach their targets from where they were in a record, with the reason."""
        return self._preflight(record).row(targets) if self.refuses else {}

    def trajectory(
        self, reader: RowReader, rows: Sequence[Sequence[float]], record: TickRecord | None
    ) -> Trajectory:
        """The trajectory of rows, checked from where the robots were in a record.

        Raises:
            RemoteError: rows are wrong, out of reach, or forbidden by a chain.
        """
        try:
            trajectory = trajectory_of_rows(reader, rows)
            if self.refuses:
                trajectory = self._preflight(record).trajectory(trajectory, "rows")
        except BadInputError as error:
            raise _bad_target(error) from None
        return trajectory

    def _preflight(self, record: TickRecord | None) -> Preflight:
        commands = {name: self._view.command(name, record) for name in self._view.configs}
        seeds = {name: command for name, command in commands.items() if command is not None}
        configs, unreachable = tuple(self._view.configs.values()), self._control.unreachable
        return Preflight(configs, self._guards, unreachable, seeds, self._clearance)


def _bad_target(error: BadInputError) -> RemoteError:
    """The refusal of rows or a point, with the first findings."""
    return RemoteError(Code.BAD_TARGET, "\n".join(map(str, error.findings[:MAX_FINDINGS])))
