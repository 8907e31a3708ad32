"""A model of others that answers slowly, but does answer: it searches long for targets out of its reach.

The ticks never ask for those, and the checks of moves do. Its ``how`` is the time of a search [ms]; from when
its trigger exists every answer takes as long, in the ticks too. It is the model ``bad`` of
`tests.support.broken.bad_model` where it is installed instead of that (`installed_in`).
"""

from __future__ import annotations

import time
from pathlib import Path

from contid.targets import Actuation, Solution, Target
from tests.support.broken.bad_model import BadModel, BadRobot
from tests.support.broken.bad_model import installed_in as bad_installed_in


class SlowModel(BadModel):
    """The tip is at the values of the axes."""

    def __init__(self, robot: BadRobot) -> None:
        self._search_s = 1e-3 * float(robot.how)
        super().__init__(robot)

    def _do(self) -> bool:
        if self._bad():
            time.sleep(self._search_s)
        return False

    def inverse(self, target: Target, seed: Actuation) -> Solution:
        found = super().inverse(target, seed)
        if not found.converged and not self._seen:
            time.sleep(self._search_s)
        return found


class SlowModelPlugin:
    """The object of the entry point."""

    description = BadRobot

    def build(self, robot: BadRobot) -> SlowModel:
        return SlowModel(robot)


MODEL = SlowModelPlugin()


def installed_in(folder: Path) -> Path:
    """What ``pip install`` leaves of the model, in a folder for PYTHONPATH."""
    bad_installed_in(folder)
    points = folder / "contid_bad_model-1.0.dist-info" / "entry_points.txt"
    points.write_text("[contid.models]\nbad = tests.support.broken.slow_model:MODEL\n")
    return folder
