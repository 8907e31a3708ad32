"""A model of others that answers slowly, but does answer: its thorough searches, and the rest when asked.

Its ``how`` is the time of a search [ms]; in the ticks it searches at once. From when its trigger exists it
takes as long for every answer, in the ticks too. It is the model ``bad`` of `tests.support.broken.bad_model`
where it is installed instead of that (`installed_in`).
"""

from __future__ import annotations

import time
from pathlib import Path

from contid.targets import Actuation, Solution, Target
from tests.support.broken.bad_model import BadModel, BadRobot
from tests.support.broken.bad_model import installed_in as bad_installed_in


class SlowModel(BadModel):
    """The tip is at the values of the axes."""

    def __init__(self, robot: BadRobot, *, thorough: bool = True) -> None:
        self._robot, self._thorough = robot, thorough
        super().__init__(robot)

    def for_ticks(self) -> SlowModel:
        return SlowModel(self._robot, thorough=False)

    def _do(self) -> bool:
        if self._bad():
            self._take()
        return False

    def _take(self) -> None:
        time.sleep(1e-3 * float(self._robot.how))

    def inverse(self, target: Target, seed: Actuation) -> Solution:
        if self._thorough and not self._seen:
            self._take()
        return super().inverse(target, seed)


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
