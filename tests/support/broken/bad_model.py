"""A model of others with every defect: tips are its axes until a file appears, then what its key names.

It is installed by an entry point (`installed_in`), so contid has it in a process of its own, as any plug-in.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from contid.robot_file.base import LengthInterval, Quantity
from contid.robot_file.robot import RobotDescription
from contid.targets import ZERO3, Actuation, Pose, Solution, Target, Vec3
from contid.units import MM_PER_M
from tests.support.bad_driver import DEEDS as DEEDS_OF_ALL
from tests.support.bad_driver import spun

Answer = Callable[[Solution], Any]

DEEDS: dict[str, Callable[[], Any]] = {**DEEDS_OF_ALL, "computes for long": lambda: spun(0.8)}

#: What is answered instead of a solution.
ANSWERS: dict[str, Answer] = {
    "None": lambda right: None,
    "text": lambda right: "up",
    "a class of its own": lambda right: type("Guess", (), {})(),
    "NaN": lambda right: replace(right, actuation=(float("nan"), 0.05)),
    "too few axes": lambda right: replace(right, actuation=(0.05,)),
    "no axes": lambda right: replace(right, actuation=()),
    "a number as axes": lambda right: replace(right, actuation=0.05),  # type: ignore[arg-type]
    "text as an axis": lambda right: replace(right, actuation=("left", 0.05)),  # type: ignore[arg-type]
    "None as residual": lambda right: replace(right, residual_m=None),  # type: ignore[arg-type]
    "a set as limits": lambda right: replace(right, limited_by={"left"}),  # type: ignore[arg-type]
    "a long note": lambda right: replace(right, note="x" * 10**7),
}
#: Defects of the next process, after this one has ended.
BUILDS: dict[str, Callable[[], Any]] = {
    "build raises": DEEDS["raise"],
    "build exits": DEEDS["exit 0"],
    "build hangs": DEEDS["hang"],
}
KINDS = (*DEEDS, *ANSWERS, *BUILDS, "sound")


class BadRobot(RobotDescription):
    """Two axes in a plane.

    Attributes:
        model: ``bad``.
        length_mm: limits of both axes.
        how: the defect.
        trigger: file that begins it.
    """

    quantity: ClassVar[Quantity] = Quantity.LENGTH
    dimension: ClassVar[int] = 2

    model: Literal["bad"]
    length_mm: LengthInterval
    how: str
    trigger: str

    @property
    def axis_names(self) -> tuple[str, ...]:
        return ("left", "right")

    @property
    def lower(self) -> Actuation:
        return (self.length_mm[0] / MM_PER_M,) * 2

    @property
    def upper(self) -> Actuation:
        return (self.length_mm[1] / MM_PER_M,) * 2


class BadModel:
    """The model: the tip is at the values of the axes."""

    dimension = 2

    def __init__(self, robot: BadRobot) -> None:
        self.axis_names, self.lower, self.upper = robot.axis_names, robot.lower, robot.upper
        self._how, self._trigger = robot.how, Path(robot.trigger)
        self._looked_s, self._seen = 0.0, False
        if self._bad():
            BUILDS.get(self._how, lambda: None)()

    def _bad(self) -> bool:
        if self._how != "sound" and not self._seen and time.monotonic() - self._looked_s > 0.05:
            self._looked_s, self._seen = time.monotonic(), self._trigger.exists()
        return self._seen

    def _do(self) -> bool:
        """Do what the defect is; True when it is one of answers."""
        if self._bad():
            if self._how in BUILDS:
                os.abort()
            DEEDS.get(self._how, lambda: None)()
        return self._seen and self._how in ANSWERS

    def forward(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Pose:
        self._do()
        tip = (actuation[0], actuation[1], 0.0)
        return Pose(tip, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0), tip)

    def inverse(self, target: Target, seed: Actuation) -> Solution:
        asked = target.actuation or (target.tip_m or (*seed, 0.0))[:2]
        inside = tuple(
            min(max(value, low), high) for value, low, high in zip(asked, self.lower, self.upper, strict=True)
        )
        off_m = max(abs(a - b) for a, b in zip(asked, inside, strict=True))
        right = Solution(inside, off_m, off_m == 0.0, () if off_m == 0.0 else ("left.max",))
        return ANSWERS[self._how](right) if self._do() else right

    def shape(self, actuation: Actuation, points: int, load_n: Vec3 = ZERO3) -> Any:
        self._do()
        return np.linspace((0.0, 0.0, 0.0), (actuation[0], actuation[1], 0.0), points)

    def jacobian(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Any:
        self._do()
        return np.eye(3, 2)


class BadModelPlugin:
    """The object of the entry point."""

    description = BadRobot

    def build(self, robot: BadRobot) -> BadModel:
        return BadModel(robot)


MODEL = BadModelPlugin()
#: Environment variable with a file for the ids of the processes that have imported this module.
IMPORTED = "BAD_MODEL_IMPORTED"
if IMPORTED in os.environ:
    with Path(os.environ[IMPORTED]).open("a") as file:
        file.write(f"{os.getpid()}\n")

ROBOT = """\
  {name}:
    model: bad
    length_mm: [0, 100]
    how: {how}
    trigger: {trigger}
    rates: {{velocity_mm_s: 100, acceleration_mm_s2: 1000, jerk_mm_s3: 20000}}
    stop: {{on_end: hold, on_interrupt: hold, on_fault: hold, on_host_loss: relax}}
    axes:
      left: {{bus: {bus}, device: servo, velocity_deg_s: 1200, mm_per_rev: 37.7}}
      right: {{bus: {bus}, device: servo, velocity_deg_s: 1200, mm_per_rev: 37.7}}
"""


def installed_in(folder: Path) -> Path:
    """What ``pip install`` leaves of the model, in a folder for PYTHONPATH."""
    metadata = folder / "contid_bad_model-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: contid-bad-model\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(
        "[contid.models]\nbad = tests.support.broken.bad_model:MODEL\n"
    )
    return folder
