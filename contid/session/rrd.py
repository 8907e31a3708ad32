"""A session as a Rerun recording: what the robots looked like and what their axes did.

Entities: ``robots/NAME/backbone`` (the commanded model's line), ``robots/NAME/target`` and
``robots/NAME/measured`` (the backbone of the sampled actuation), ``plots/NAME/command`` and ``/sample``
(every axis, mm or bar), ``plots/NAME/tip_error_mm``, ``plots/lateness_us``. Timelines ``tick`` and ``time``.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from contid.control.plan import RobotPlan
from contid.control.record import TickRecord
from contid.control.wiring import build_plans
from contid.description.load import LoadedFile
from contid.session.read import Session

#: Points of a backbone, and pictures per second; more cannot be seen.
POINTS: Final = 32
FRAMES_HZ: Final = 50.0
#: Ticks that are sent in one batch.
BATCH: Final = 2048


def export_rrd(session: Session, loaded: LoadedFile, path: Path) -> None:
    """Write a recording for the Rerun viewer."""
    import rerun as rr

    recording = rr.RecordingStream("contid", recording_id=session.path.stem)
    recording.save(path)
    plans = build_plans(loaded, session.rate_hz)
    every = max(round(session.rate_hz / FRAMES_HZ), 1)
    for plan in plans:
        names = [f"{axis} [{plan.quantity.unit}]" for axis in plan.axis_names]
        for what in ("command", "sample"):
            lines = rr.SeriesLines(names=[f"{what} {name}" for name in names])
            recording.log(f"plots/{plan.name}/{what}", lines, static=True)
    batch: list[TickRecord] = []
    for record in session.ticks():
        batch.append(record)
        if len(batch) >= BATCH:
            _send(recording, plans, session.rate_hz, every, batch)
            batch = []
    if batch:
        _send(recording, plans, session.rate_hz, every, batch)
    recording.flush()
    recording.disconnect()


def _send(
    recording: Any, plans: Sequence[RobotPlan], rate_hz: float, every: int, batch: Sequence[TickRecord]
) -> None:
    import rerun as rr

    def times(records: Sequence[TickRecord]) -> list[Any]:
        ticks = np.array([record.tick for record in records])
        return [rr.TimeColumn("tick", sequence=ticks), rr.TimeColumn("time", duration=ticks / rate_hz)]

    def scalars(entity: str, records: Sequence[TickRecord], values: Any) -> None:
        columns = rr.Scalars.columns(scalars=np.asarray(values))
        recording.send_columns(entity, indexes=times(records), columns=columns)

    scalars("plots/lateness_us", batch, [record.lateness_s * 1e6 for record in batch])
    for index, plan in enumerate(plans):
        per_si = plan.quantity.per_si
        commands = np.array([[axis.command for axis in record.robots[index].axes] for record in batch])
        known = ~np.isnan(commands).any(axis=1)
        armed = [record for record, is_known in zip(batch, known, strict=True) if is_known]
        if not armed:
            continue
        scalars(f"plots/{plan.name}/command", armed, commands[known] * per_si)
        errors = [record.robots[index].tip_error_m * 1e3 for record in armed]
        scalars(f"plots/{plan.name}/tip_error_mm", armed, errors)
        measured = [
            plan.transmission.to_actuation(tuple(axis.value for axis in record.robots[index].axes))
            for record in armed
        ]
        scalars(f"plots/{plan.name}/sample", armed, np.array(measured) * per_si)
        frames = [number for number, record in enumerate(armed) if record.tick % every == 0]
        shown = [armed[number] for number in frames]
        if not shown:
            continue
        for what, actuations in (("backbone", commands[known]), ("measured", np.array(measured))):
            strips = [_backbone(plan, tuple(actuations[number].tolist())) for number in frames]
            columns = rr.LineStrips3D.columns(strips=[[strip] for strip in strips])
            recording.send_columns(f"robots/{plan.name}/{what}", indexes=times(shown), columns=columns)
        wanted = [record for record in shown if not np.isnan(record.robots[index].tip_m[0])]
        if wanted:
            points = np.array([record.robots[index].tip_m for record in wanted])
            columns = rr.Points3D.columns(positions=points)
            recording.send_columns(f"robots/{plan.name}/target", indexes=times(wanted), columns=columns)


def _backbone(plan: RobotPlan, actuation: tuple[float, ...]) -> Any:
    """Points of a backbone in the world frame [m]; nothing where an axis was never sampled."""
    if np.isnan(actuation).any():
        return np.zeros((0, 3))
    points = plan.model.shape(actuation, POINTS)
    return points @ np.array(plan.frame.rotation).reshape(3, 3).T + np.array(plan.frame.origin_in_world)
