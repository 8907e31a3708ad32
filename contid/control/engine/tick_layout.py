"""What one tick leaves behind, and how it lies in a slot of the ring.

Everything is a float64 or a uint64 at a fixed place, so the control process packs a tick with one call and
no object crosses a process border. A reader gets the layout as JSON from the head of the ring: it needs
neither the robot file nor a model.

A slot holds ``tick, skipped`` (uint64), ``deadline_s, lateness_s, work_s, source_s`` (float64), then per
robot the fields of `RobotRecord` in order, then per axis those of `AxisRecord`. What is absent is NaN.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Final, NamedTuple

NAN3: Final = (math.nan,) * 3

# Bits of RobotRecord.flags.
HAS_TARGET: Final = 1
CONVERGED: Final = 2
ENABLED: Final = 4


class AxisRecord(NamedTuple):
    """One axis at one tick: what was wanted, asked, commanded and read.

    Attributes:
        target: actuation the target asked for itself [m or Pa]; NaN for tip targets.
        solution: actuation the model answered [m or Pa].
        command: actuation commanded after the limits [m or Pa].
        limits: bits of `contid.control.tick.limits` that bound this axis.
        device: commanded device value [rad or Pa]; NaN when nothing was commanded.
        value: sample [rad or Pa].
        time_s: when it was measured.
        valid: 1 when the newest exchange read it.
        age_s: its age at the end of that exchange.
        velocity: [rad/s or Pa/s].
        effort: [A] or duty.
        temperature_c: [deg C].
        voltage_v: [V].
    """

    target: float
    solution: float
    command: float
    limits: float
    device: float
    value: float
    time_s: float
    valid: float
    age_s: float
    velocity: float
    effort: float
    temperature_c: float
    voltage_v: float


class RobotRecord(NamedTuple):
    """One robot at one tick; positions and directions in the world frame.

    Attributes:
        mode: `contid.control.tick.supervisor.Mode`.
        fault: `contid.control.tick.faults.Fault`.
        flags: HAS_TARGET, CONVERGED, ENABLED.
        limited_by: bits; their names are events (``limit_name``) of the ring.
        iterations: of the solver.
        tip_m: target.
        direction: target.
        mid_m: target.
        load_n: known tip load.
        residual_m: of the solution.
        tip_error_m: distance of the commanded model's tip from the target.
        measured_tip_m: where a tracker saw the tip; NaN when none did within a second.
        measured_direction: unit tangent it saw there; NaN when it saw none.
        measured_age_s: since that was captured.
        axes: one per axis of the robot.
    """

    mode: int
    fault: int
    flags: int
    limited_by: int
    iterations: int
    tip_m: tuple[float, float, float]
    direction: tuple[float, float, float]
    mid_m: tuple[float, float, float]
    load_n: tuple[float, float, float]
    residual_m: float
    tip_error_m: float
    measured_tip_m: tuple[float, float, float]
    measured_direction: tuple[float, float, float]
    measured_age_s: float
    axes: tuple[AxisRecord, ...]


class TickRecord(NamedTuple):
    """One tick of the whole robot file.

    Attributes:
        tick: its number; numbers that are missing were skipped.
        skipped: ticks skipped so far.
        deadline_s: when it should have started, on the clock of the buses.
        lateness_s: how much later it did start.
        work_s: how long it took, up to the record itself.
        source_s: time in the trajectory, NaN while none runs.
        robots: in the order of the layout.
    """

    tick: int
    skipped: int
    deadline_s: float
    lateness_s: float
    work_s: float
    source_s: float
    robots: tuple[RobotRecord, ...]


@dataclass(frozen=True, slots=True)
class RobotLayout:
    """A robot as a reader of the ring needs it: name, model, unit suffix of its actuation, axes."""

    name: str
    model: str
    quantity: str
    axes: tuple[str, ...]


HEAD: Final = "QQdddd"
ROBOT: Final = "QQQQQ21d"
AXIS: Final = "13d"
HEAD_VALUES: Final = 6
ROBOT_VALUES: Final = 26
AXIS_VALUES: Final = 13


@dataclass(frozen=True, slots=True)
class RecordLayout:
    """Where everything lies in a slot."""

    name: str
    rate_hz: float
    robots: tuple[RobotLayout, ...]

    def packer(self) -> struct.Struct:
        """The whole record as one struct: head, then per robot its fields and its axes."""
        return struct.Struct("=" + HEAD + "".join(ROBOT + AXIS * len(robot.axes) for robot in self.robots))

    def to_json(self) -> str:
        """The layout for the head of the ring."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> RecordLayout:
        """The layout back from the head of the ring."""
        raw = json.loads(text)
        robots = tuple(RobotLayout(**{**robot, "axes": tuple(robot["axes"])}) for robot in raw["robots"])
        return cls(raw["name"], raw["rate_hz"], robots)

    def decode(self, values: tuple[float, ...]) -> TickRecord:
        """A record from the values of `packer`."""
        at = HEAD_VALUES
        robots = []
        for robot in self.robots:
            head = values[at : at + ROBOT_VALUES]
            at += ROBOT_VALUES
            axes = []
            for _ in robot.axes:
                axes.append(AxisRecord(*values[at : at + AXIS_VALUES]))
                at += AXIS_VALUES
            robots.append(_robot(head, axes))
        tick, skipped, deadline_s, lateness_s, work_s, source_s = values[:HEAD_VALUES]
        return TickRecord(int(tick), int(skipped), deadline_s, lateness_s, work_s, source_s, tuple(robots))


def _robot(head: tuple[float, ...], axes: Iterable[AxisRecord]) -> RobotRecord:
    mode, fault, flags, limited_by, iterations = (int(value) for value in head[:5])
    return RobotRecord(
        mode, fault, flags, limited_by, iterations,
        (head[5], head[6], head[7]), (head[8], head[9], head[10]),
        (head[11], head[12], head[13]), (head[14], head[15], head[16]),
        head[17], head[18],
        (head[19], head[20], head[21]), (head[22], head[23], head[24]), head[25], tuple(axes),
    )  # fmt: skip
