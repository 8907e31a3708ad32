"""One row of a live stream before it goes to the robots: which targets, which refusals, which edges instead.

A row that cannot be read holds its robots. A robot whose target is out of reach holds; in a stream that asks
for ``nearest`` it goes along the edge of its reach instead, if some point of that is nearer to the target.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from contid.control.engine.measured_tip import tip_in_world
from contid.control.engine.tick_layout import TickRecord
from contid.control.tick.config import RobotConfig
from contid.control.tick.preflight.edge import along_the_edge, off_the_reach_m
from contid.errors import BadInputError
from contid.kinematics.model import Bending
from contid.remote.server.move import LiveMove
from contid.remote.server.preconditions import Preconditions
from contid.remote.server.telemetry_view import TelemetryView
from contid.targets import Actuation, Target
from contid.units import MM_PER_M


class CheckedRow(NamedTuple):
    """What becomes of a row.

    Attributes:
        targets: by robot, in the world frame; None holds the robot.
        refused: messages about what is refused.
        reached: where columns go that go elsewhere than the row states, in the units of the columns [mm].
    """

    targets: Mapping[str, Target | None]
    refused: list[str]
    reached: Mapping[str, float]


class _LiveStep(NamedTuple):
    """The step of a robot from one target to the next (world frame), and its last command."""

    config: RobotConfig
    target: Target
    before: Target
    command: Actuation


class LiveRows:
    """Checks rows against the newest record of the run."""

    def __init__(self, view: TelemetryView, preconditions: Preconditions) -> None:
        self._view = view
        self._preconditions = preconditions

    def check(self, move: LiveMove, row: Sequence[float], record: TickRecord | None) -> CheckedRow:
        """Check the next row of a move where the robots are in a record; it becomes the last one."""
        move.count += 1
        layout = move.reader.layout
        try:
            targets: dict[str, Target | None] = {**layout.targets(move.reader.row(row, move.count))}
        except BadInputError as error:
            return CheckedRow(dict.fromkeys(move.reader.robots), [str(error)], {})
        refused = self._preconditions.unreachable(targets, record)
        edges: dict[str, Target] = {}
        if move.nearest and self._preconditions.refuses:
            steps = self.steps(targets, move.last, record)
            refused = _beside(steps) | refused
            edges = self._edges(targets, steps, refused, record)
            refused = {name: why for name, why in refused.items() if name not in edges}
        targets |= edges | dict.fromkeys(refused)
        move.last |= {name: target for name, target in targets.items() if target is not None}
        messages = [f"rows:{move.count}: {message}" for message in refused.values()]
        return CheckedRow(targets, messages, layout.moved_mm(edges))

    def steps(
        self, targets: Mapping[str, Target | None], last: Mapping[str, Target], record: TickRecord | None
    ) -> dict[str, _LiveStep]:
        """By robot its step from its last target, or without one from where it is commanded to."""
        found = {}
        for name, target in targets.items():
            config, command = self._view.configs[name], self._view.command(name, record)
            if command is None or target is None:
                continue
            tip_m = tip_in_world(config, command, target.load_n)
            model, load_n = config.model, config.frame.vector_in_base(target.load_n)
            arcs = model.arcs(command, load_n) if isinstance(model, Bending) else None
            here = Target(tip_m=tip_m, arcs=None if arcs is None else tuple(arcs.ravel().tolist()))
            found[name] = _LiveStep(config, target, last.get(name, here), command)
        return found

    def _edges(
        self,
        targets: Mapping[str, Target | None],
        steps: Mapping[str, _LiveStep],
        refused: Collection[str],
        record: TickRecord | None,
    ) -> dict[str, Target]:
        """Targets within reach in place of refused ones (`along_the_edge`), where those without one hold."""
        found = {
            name: edge
            for name, step in steps.items()
            if name in refused and (edge := along_the_edge(*step)) is not None
        }
        row = {**targets, **dict.fromkeys(refused), **found}
        again = self._preconditions.unreachable(row, record) if found else {}
        return {name: edge for name, edge in found.items() if name not in again}


def _beside(steps: Mapping[str, _LiveStep]) -> dict[str, str]:
    """Robots whose step leads beside their reach, by what the tolerance of the file takes; the reason."""
    return {
        name: f"{name}: this leads {off_m * MM_PER_M:.3g} mm out of reach, and no point of it is nearer"
        for name, step in steps.items()
        if (off_m := off_the_reach_m(*step)) > 0.0
    }
