"""Draws the estimated force on a tip as an arrow from it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import rerun as rr

from contid.control.engine.tick_layout import RobotRecord
from contid.kinematics.array import Array
from contid.robot_file.cosserat import Cosserat
from contid.units import STANDARD_GRAVITY
from contid_view import paths
from contid_view.colours import LOAD
from contid_view.rerun.stream import RerunStream
from contid_view.robot_scene import RobotScene

#: Length of the arrow of the expected load, as a share of the robot's length.
_SHARE: Final = 0.5


def mm_per_newton(expected_g: float, length_mm: float) -> float:
    """Scale at which the expected load is half as long as the robot."""
    return _SHARE * length_mm / (expected_g * 1e-3 * STANDARD_GRAVITY)


class RerunLoadArrow:
    """The arrow of one robot in a recording."""

    def __init__(self, stream: RerunStream, robot: RobotScene, sensing: Cosserat) -> None:
        assert sensing.sense is not None
        self._stream = stream
        self._entity = paths.body(robot.config.name, "load")
        expected_g = sensing.sense.load.expected_g
        self._scale = mm_per_newton(expected_g, robot.length_mm)
        look = rr.Arrows3D.from_fields(
            colors=[LOAD],
            radii=rr.Radius.ui_points(2.0),
            labels=[f"half the arm's length: {expected_g:g} g"],
            show_labels=False,
        )
        stream.static(self._entity, look)

    def write(self, ticks: Sequence[int], records: Sequence[RobotRecord], tips: Sequence[Array]) -> None:
        """The arrow at every tick; none without an estimate. Tips in the world [mm], shape ``(1, 3)``."""
        forces = np.array([record.estimated_load_n for record in records], dtype=np.float64)
        origins = np.array(tips, dtype=np.float64).reshape(-1, 3)
        unknown = ~np.isfinite(np.hstack([forces, origins])).all(axis=1)
        vectors = self._scale * forces
        origins[unknown], vectors[unknown] = np.nan, 0.0
        columns = rr.Arrows3D.columns(origins=origins.astype(np.float32), vectors=vectors.astype(np.float32))
        self._stream.send(self._entity, ticks, columns)
