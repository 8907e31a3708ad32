"""The slowest modes of a robot at its pose, as lines that a page animates."""

from __future__ import annotations

from typing import Final

import numpy as np

from contid.errors import ContidError
from contid.remote.protocol.wire import Fields
from contid.targets import Actuation
from contid_dynamics.swing import SwingingPose
from contid_panel.described_robot import swings
from contid_panel.geometry import PanelGeometry
from contid_panel.samples import rounded_line

#: Modes that a page shows.
MODES: Final = 3


def modes(geometry: PanelGeometry, name: str, actuation: Actuation) -> Fields:
    """The modes of a robot that rests under an actuation [m or Pa].

    Returns:
        ``modes``: ``frequency_hz``, ``ratio``, and ``lines`` of the backbone in the world [mm]: to one
        side, at rest, to the other, so large that the farthest point moves by 0.12 of the length.

    Raises:
        ContidError: the robot has no `dynamics`, or no equilibrium was found.
    """
    description = geometry.loaded.driven[name]
    if not swings(description):
        raise ContidError(f"{name} has no dynamics in its robot file: how it swings is not known")
    robot = next(each for each in geometry.scene.robots if each.config.name == name)
    try:
        pose = SwingingPose(description, actuation[: len(description.axis_names)], MODES)
    except ArithmeticError as error:
        raise ContidError(f"{name}: {error}; how it swings here is not known") from None
    found = [
        {
            "frequency_hz": mode.frequency_hz,
            "ratio": mode.ratio,
            "lines": [
                rounded_line(np.asarray(robot.in_world_mm(pose.line_m(k, share))))
                for share in (-1.0, 0.0, 1.0)
            ],
        }
        for k, mode in enumerate(pose.modes.modes)
    ]
    return {"modes": found}
