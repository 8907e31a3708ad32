"""Sending recorded commands to real buses, as a timed trajectory in actuator space.

Like every trajectory they are checked before the robot moves, approached with limited jerk, limited at every
tick and ended by the stop policies of the robot file.
"""

from __future__ import annotations

import asyncio
import math
from array import array

import numpy as np

from contid.control.daemon.control_child import ControlChild
from contid.control.daemon.daemon import Daemon
from contid.control.daemon.run_request import RunOptions
from contid.control.engine.report import RunReport
from contid.control.engine.tick_layout import TICK
from contid.control.engine.wiring import build_preflight
from contid.control.process.isolation.model_ports import models_beside
from contid.control.process.tick_alarm import LONGEST_S
from contid.control.tick.preflight.rows import Unreachable
from contid.errors import ContidError
from contid.robot_file.load import LoadedFile
from contid.session.read import Session
from contid.trajectory.columns import TIME, read_layout
from contid.trajectory.timed import Interpolation, Trajectory
from contid_sessions.replay.differences import refuse_another_robot


def recorded_commands(session: Session, loaded: LoadedFile) -> Trajectory:
    """The commands of a session as a trajectory: one row per tick, time 0 at the first command.

    A robot that was armed later than others waits at its first command.

    Raises:
        ContidError: there are none, or a robot does not accept actuation.
    """
    names = [TIME]
    slots = []
    for index, robot in enumerate(session.layout.robots):
        for number, axis in enumerate(robot.axes):
            names.append(f"{robot.name}.{axis}_{robot.units[number]}")
            slots.append(session.layout.axis_place(index, number, "command"))
    rows, first = array("d"), -1
    for entry in session.entries():
        if entry.values is None:
            continue
        commands = [entry.values[slot] for slot in slots]
        if all(map(math.isnan, commands)):
            continue
        first = int(entry.values[TICK]) if first < 0 else first
        rows.append((int(entry.values[TICK]) - first) / session.rate_hz)
        rows.extend(commands)
    if first < 0:
        raise ContidError(f"{session.path}: no robot was ever commanded")
    table = np.frombuffer(rows, dtype=np.float64).reshape(-1, len(names)).copy()
    for column in range(1, len(names)):
        given = np.flatnonzero(~np.isnan(table[:, column]))
        if not len(given):
            raise ContidError(f"{session.path}: {names[column]} was never commanded")
        # Gaps take the last command before them, those at the beginning the first command.
        last = np.maximum.accumulate(np.where(np.isnan(table[:, column]), -1, np.arange(len(table))))
        table[:, column] = table[np.where(last < 0, given[0], last), column]
    layout = read_layout([(name, 1) for name in names], str(session.path), 1, loaded.driven)
    table.setflags(write=False)
    return Trajectory(layout, table, range(1, len(table) + 1), Interpolation.LINEAR)


def run_on_hardware(session: Session, recorded: LoadedFile, loaded: LoadedFile) -> RunReport:
    """Send the commands of a session, with robot file ``recorded``, to the buses of ``loaded``.

    Raises:
        ContidError: other robots, ids or limits; no bus is opened.
    """
    refuse_another_robot(recorded, loaded)
    trajectory = recorded_commands(session, loaded)
    rate_hz = session.rate_hz
    preflight = build_preflight(loaded, rate_hz, Unreachable.REFUSE)
    if preflight is not None:
        preflight.trajectory(trajectory, str(session.path))
    child = ControlChild()
    try:
        with models_beside(loaded, LONGEST_S) as own:
            return asyncio.run(Daemon(own, trajectory, RunOptions(rate_hz=rate_hz), child).run())
    finally:
        child.close()
