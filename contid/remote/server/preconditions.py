"""The conditions of a move: robots armed and without a fault, every target within reach."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Final

from contid.control.daemon.interfaces import RunControl
from contid.control.engine.measured_tip import tip_in_world
from contid.control.engine.tick_layout import TickRecord
from contid.control.engine.wiring import chain_guards, clearance_guard
from contid.control.tick.config import RobotConfig
from contid.control.tick.preflight.edge import along_the_edge, off_the_reach_m
from contid.control.tick.preflight.rows import Preflight, Unreachable
from contid.control.tick.supervisor import Mode
from contid.errors import BadInputError
from contid.kinematics.model import Bending
from contid.remote.protocol.wire import Code, RemoteError
from contid.remote.server.telemetry_view import TelemetryView
from contid.targets import Actuation, Target
from contid.trajectory.columns import MAX_FINDINGS
from contid.trajectory.read import trajectory_of_rows
from contid.trajectory.rows import RowReader
from contid.trajectory.timed import Trajectory
from contid.units import MM_PER_M

_ARMED: Final = frozenset({Mode.APPROACH, Mode.RUN, Mode.HOLD})


class Preconditions:
    """Checks moves against the newest record and the models."""

    def __init__(self, control: RunControl, view: TelemetryView) -> None:
        self._control = control
        self._view = view
        self._guards = chain_guards(control.loaded)
        self._clearance = clearance_guard(control.loaded)
        self._refuses = control.unreachable is Unreachable.REFUSE or bool(self._guards)

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
            if mode not in _ARMED:
                raise RemoteError(Code.NOT_ARMED, f"{name} is {mode.name}, not armed; resume first")

    def unreachable(self, targets: Mapping[str, Target | None]) -> dict[str, str]:
        """Robots that cannot reach their targets from where they are, with the reason."""
        return self._preflight(self._control.newest()).row(targets) if self._refuses else {}

    def edges(
        self, targets: Mapping[str, Target | None], last: Mapping[str, Target], robots: Collection[str]
    ) -> dict[str, Target]:
        """Targets within reach that robots go to in place of targets out of it (`along_the_edge`).

        Args:
            targets: of all robots.
            last: those that were taken before them; where robots are commanded to without.
            robots: whose targets are refused.
        """
        found = {}
        for name, step in self._steps({name: targets[name] for name in robots}, last).items():
            edge = along_the_edge(*step)
            if edge is not None:
                found[name] = edge
        if not found or self.unreachable({**targets, **found}):
            return {}
        return found

    def beside(self, targets: Mapping[str, Target | None], last: Mapping[str, Target]) -> dict[str, str]:
        """Robots whose step leads beside their reach, by what the tolerance of the file takes; the reason.

        The arguments are those of `edges`.
        """
        steps = self._steps(targets, last).items() if self._refuses else ()
        return {
            name: f"{name}: this leads {off_m * MM_PER_M:.3g} mm out of reach, and no point of it is nearer"
            for name, step in steps
            if (off_m := off_the_reach_m(*step)) > 0.0
        }

    def _steps(
        self, targets: Mapping[str, Target | None], last: Mapping[str, Target]
    ) -> dict[str, tuple[RobotConfig, Target, Target, Actuation]]:
        """By robot its configuration, target, the target before it, and last command."""
        record, found = self._control.newest(), {}
        for name, target in targets.items():
            config, command = self._view.configs[name], self._view.command(name, record)
            if command is None or target is None:
                continue
            tip_m = tip_in_world(config, command, target.load_n)
            model, load_n = config.model, config.frame.vector_in_base(target.load_n)
            arcs = model.arcs(command, load_n) if isinstance(model, Bending) else None
            here = Target(tip_m=tip_m, arcs=None if arcs is None else tuple(arcs.ravel().tolist()))
            found[name] = config, target, last.get(name, here), command
        return found

    def trajectory(
        self, reader: RowReader, rows: Sequence[Sequence[float]], record: TickRecord | None
    ) -> Trajectory:
        """The trajectory of rows, checked from where the robots were in a record.

        Raises:
            RemoteError: rows are wrong, out of reach, or forbidden by a chain.
        """
        try:
            trajectory = trajectory_of_rows(reader, rows)
            if self._refuses:
                trajectory = self._preflight(record).trajectory(trajectory, "rows")
        except BadInputError as error:
            raise bad_target(error) from None
        return trajectory

    def _preflight(self, record: TickRecord | None) -> Preflight:
        commands = {name: self._view.command(name, record) for name in self._view.configs}
        seeds = {name: command for name, command in commands.items() if command is not None}
        configs, unreachable = tuple(self._view.configs.values()), self._control.unreachable
        return Preflight(configs, self._guards, unreachable, seeds, self._clearance)


def bad_target(error: BadInputError) -> RemoteError:
    """The refusal of rows or a point, with the first findings."""
    return RemoteError(Code.BAD_TARGET, "\n".join(map(str, error.findings[:MAX_FINDINGS])))
