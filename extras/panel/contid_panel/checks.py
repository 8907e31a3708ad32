"""Trajectories that a page has uploaded: checked as a whole, shown, and only then played."""

from __future__ import annotations

import asyncio
import io
import secrets
from dataclasses import dataclass
from typing import Final

from contid.errors import BadInputError, ContidError
from contid.remote.client.move_arguments import columns_and_rows
from contid.remote.protocol.wire import Code, Fields, RemoteError
from contid.trajectory.read import read_trajectory
from contid.trajectory.timed import Trajectory
from contid.units import MM_PER_M
from contid_panel.geometry import PanelGeometry
from contid_panel.hub import Hub

#: Checked trajectories that are kept; older ones are dropped.
MAX_CHECKS: Final = 4
#: Rows that the daemon takes, and findings and points of a path that a page shows.
MAX_ROWS: Final = 50_000
MAX_FINDINGS: Final = 8
MAX_POINTS: Final = 400


@dataclass(frozen=True, slots=True)
class CheckedTrajectory:
    """A trajectory that passed.

    Attributes:
        columns: of its header.
        rows: of numbers.
        summary: for the page: duration, robots, path of every tip.
    """

    columns: list[str]
    rows: list[list[float]]
    summary: Fields


class Checks:
    """The checked trajectories of a panel."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._kept: dict[str, CheckedTrajectory] = {}

    def get(self, key: str) -> CheckedTrajectory:
        """A checked trajectory.

        Raises:
            RemoteError: it is not known any more.
        """
        if key not in self._kept:
            raise RemoteError(
                Code.BAD_TARGET, "this trajectory was not checked, or too long ago; open it again"
            )
        return self._kept[key]

    async def check(self, text: str, name: str) -> Fields:
        """Check a trajectory from where the robots are; a summary, or the first findings."""
        geometry = self._hub.geometry
        if geometry is None:
            return {"ok": False, "findings": ["the robot file is not available here; use `contid move`"]}
        try:
            # In a thread: a stop must not wait for the check of a large file.
            checked = await asyncio.to_thread(self._checked, geometry, text, name)
        except BadInputError as error:
            return {"ok": False, "findings": [str(found) for found in error.findings[:MAX_FINDINGS]]}
        except ContidError as error:
            return {"ok": False, "findings": [str(error)]}
        key = secrets.token_hex(8)
        self._kept[key] = checked
        if len(self._kept) > MAX_CHECKS:
            del self._kept[next(iter(self._kept))]
        return {"ok": True, "check": key, **checked.summary}

    def _checked(self, geometry: PanelGeometry, text: str, name: str) -> CheckedTrajectory:
        trajectory = read_trajectory(io.StringIO(text), name, geometry.loaded.driven)
        if len(trajectory) > MAX_ROWS:
            raise ContidError(f"{name}: {len(trajectory)} rows; a client may send {MAX_ROWS}")
        geometry.preflight(self._hub.commands()).trajectory(trajectory, name)
        columns, rows = columns_and_rows(io.StringIO(text))
        summary = {
            "name": name,
            "rows": len(trajectory),
            "duration_s": trajectory.end_s - trajectory.start_s,
            "paths": _paths(geometry, trajectory),
        }
        return CheckedTrajectory(columns, list(rows), summary)


def _paths(geometry: PanelGeometry, trajectory: Trajectory) -> dict[str, list[list[float]]]:
    """The tip of every robot along the trajectory [mm], in the world frame."""
    configs = {robot.config.name: robot.config for robot in geometry.scene.robots}
    found: dict[str, list[list[float]]] = {}
    step_s = (trajectory.end_s - trajectory.start_s) / MAX_POINTS
    for number in range(MAX_POINTS + 1):
        for name, target in trajectory.targets_at(trajectory.start_s + number * step_s).items():
            tip_m = target.tip_m
            if tip_m is None and target.actuation is not None:
                config = configs[name]
                tip_m = config.frame.point_in_world(config.model.forward(target.actuation).tip_m)
            if tip_m is not None:
                found.setdefault(name, []).append([round(value * MM_PER_M, 2) for value in tip_m])
    return found
