"""The measured tip: forward kinematics of the samples, and how far it was from the target.

Session, exports, telemetry, viewer and closing report take it from here.

The residual compares the model with itself and is near rounding on every path within reach; what a robot did
is in its samples. A few records per second are enough for the closing report, and keep the arithmetic out of
the tick. It shows the error of axes and their delay, not that of the model: a tracker measures that.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Any, Final

from contid.control.engine.events import RunEvent
from contid.control.engine.tick_layout import TICK, RecordLayout, RobotRecord, TickRecord
from contid.control.tick.config import RobotConfig
from contid.control.tick.statistics import RobotTally
from contid.control.tick.supervisor import Mode
from contid.targets import Actuation, Vec3, load_or_zero

#: Records per second that are evaluated.
SAMPLES_HZ: Final = 50.0


class MeasuredTips:
    """Tally of the measured tip errors of all robots; also a sink of the engine.

    Args:
        configs: of the robots, in the order of the records.
        layout: of the records.
        robots: those to evaluate; None for all.
    """

    def __init__(
        self, configs: Sequence[RobotConfig], layout: RecordLayout, robots: Collection[str] | None = None
    ) -> None:
        self._configs = [
            (number, config)
            for number, config in enumerate(configs)
            if robots is None or config.name in robots
        ]
        self._layout = layout
        self._every = max(1, round(layout.rate_hz / SAMPLES_HZ))
        self._next = 0
        self._tallies = [RobotTally() for _ in self._configs]

    def write(self, values: list[float]) -> None:
        """See `contid.control.engine.cycle.Sink`; most records are skipped."""
        if values[TICK] >= self._next:
            self.add(self._layout.decode(tuple(values)))

    def event(self, event: RunEvent) -> None:
        """Events have no tips."""

    def add(self, record: TickRecord | None) -> None:
        """Take a record, unless its turn has not come."""
        if record is None or record.tick < self._next:
            return
        self._next = record.tick + self._every
        for (number, config), tally in zip(self._configs, self._tallies, strict=True):
            robot = record.robots[number]
            error_m = measured_tip_error_m(config, robot)
            if robot.mode == Mode.RUN and math.isfinite(error_m):
                tally.add(error_m, converged=True)

    def complete(self, robots: dict[str, dict[str, Any]]) -> None:
        """Add the figures to the reports of the robots; those without a sample in RUN get none."""
        for (_, config), tally in zip(self._configs, self._tallies, strict=True):
            if tally.followed and config.name in robots:
                figures = tally.as_dict()
                for name in ("tip_error_max_mm", "tip_error_rms_mm"):
                    robots[config.name][f"measured_{name}"] = figures[name]


def measured_actuation(config: RobotConfig, robot: RobotRecord) -> Actuation | None:
    """Actuation [m or Pa] by the samples, None until every axis has been read."""
    values = tuple([axis.value for axis in robot.axes])
    return config.transmission.to_actuation(values) if all(map(math.isfinite, values)) else None


def tip_in_world(config: RobotConfig, actuation: Actuation, load_n: Vec3) -> Vec3 | None:
    """Tip of the model [m] with the known load [N], both in the world frame; a load with NaN is none.

    None outside the domain of the model, or where it has a defect.
    """
    try:
        pose = config.model.forward(actuation, config.frame.vector_in_base(load_or_zero(load_n)))
        tip = config.frame.point_in_world(pose.tip_m)
        return tip if all(map(math.isfinite, tip)) else None
    except Exception:
        return None


def measured_tip_error_m(config: RobotConfig, robot: RobotRecord) -> float:
    """Distance of the target from the measured tip, NaN without either."""
    actuation = measured_actuation(config, robot)
    if actuation is None or not all(map(math.isfinite, robot.tip_m)):
        return math.nan
    tip = tip_in_world(config, actuation, robot.load_n)
    return math.nan if tip is None else math.dist(tip, robot.tip_m)
