"""The body of a robot that does not follow: drawn where it is measured, with the commanded one beside it."""

from __future__ import annotations

import numpy as np
import pytest

from contid.robot_file.load import load_named
from contid_panel.geometry import PanelGeometry
from contid_panel.samples import actuation_of, tip_mm


@pytest.mark.parametrize(
    ("name", "measured", "commanded"),
    [
        ("finger", (50.0, 50.0), (60.0, 50.0)),
        ("stiffflop2", (0.0,) * 6, (0.5, 0.0, 0.0, 0.0, 0.0, 0.0)),  # a hose is off
        ("tendon3", (0.0,) * 9, (4.0, -2.0, -2.0) + (0.0,) * 6),
    ],
)
def test_a_ghost_ends_at_the_commanded_tip(
    name: str, measured: tuple[float, ...], commanded: tuple[float, ...]
) -> None:
    geometry = PanelGeometry(load_named(name), 100.0)
    (robot,) = geometry.scene.robots
    label = robot.config.name
    bodies = geometry.bodies({label: measured}, {label: commanded})
    count = robot.drawing(robot.config.rest).sections  # type: ignore[union-attr]
    for lines, values in ((bodies["robots"], measured), (bodies["ghosts"], commanded)):
        tip = tip_mm(robot, actuation_of(robot, values))
        assert tip is not None
        assert np.array(lines[label][count - 1][-1]) == pytest.approx(tip, abs=0.02)


def test_a_robot_that_follows_has_no_ghost() -> None:
    geometry = PanelGeometry(load_named("finger"), 100.0)
    (robot,) = geometry.scene.robots
    label = robot.config.name
    for commanded in ((50.0, 50.0), (50.1, 50.0), None, (None, 50.0)):
        bodies = geometry.bodies({label: (50.0, 50.0)}, {label: commanded})  # type: ignore[dict-item]
        assert bodies["ghosts"] == {}
    assert geometry.bodies({label: None}, {label: (50.0, 50.0)})["ghosts"] == {}
