"""The protocol of every kinematic model, and the table that builds one from its description.

A model is pure arithmetic in the robot's base frame and SI: no I/O, no clock, no YAML. Results are frozen; an
unreachable target gives a solution with a residual, never an exception. Arrays of rows are for
`contid.kinematics.batch`; the control process makes single calls.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Final, Protocol, runtime_checkable

from contid import kernels
from contid.kinematics.any_target import tolerate
from contid.kinematics.array import Array
from contid.kinematics.isolated_robot import IsolatedRobot
from contid.robot_file.model_plugins import load_plugin
from contid.robot_file.needs import load_solver
from contid.robot_file.robot import RobotDescription
from contid.targets import ZERO3, Actuation, Pose, Solution, Target, Vec3, Wrench6
from contid.units import MM_PER_M


class Model(Protocol):
    """Forward and inverse kinematics (or statics) of one robot."""

    #: Names and limits of the actuation, in the model's order [m or Pa].
    axis_names: tuple[str, ...]
    lower: Actuation
    upper: Actuation
    #: 2 for planar models (z stays 0), 3 for spatial ones.
    dimension: int

    def forward(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Pose:
        """Pose of the tip for an actuation, with a known force on the tip [N] in the base frame."""

    def inverse(self, target: Target, seed: Actuation) -> Solution:
        """Actuation for a target given in the base frame, inside every limit.

        Args:
            target: see `Target`; a ``target.actuation`` is clamped into the limits.
            seed: the last commanded actuation; keeps the answer continuous where it is not unique.
        """

    def shape(self, actuation: Actuation, points: int, load_n: Vec3 = ZERO3) -> Array:
        """Backbone from base to tip at equal arc length, shape ``(points, 3)`` [m]."""

    def jacobian(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Array:
        """Derivative of the tip position by the actuation, shape ``(3, len(axis_names))``."""


@runtime_checkable
class Searching(Protocol):
    """A model that searches for the nearest pose to a target out of reach, longer than a tick can wait."""

    def for_ticks(self) -> Model:
        """The same model with short searches: their answers may be farther from such targets."""


@runtime_checkable
class Following(Protocol):
    """A model that follows the nearest pose to tips out of reach, instead of searching for it each time."""

    def follows(self, load_n: Vec3) -> bool:
        """False where the way of the axes decides which pose is reached, as under a force on the tip [N]."""

    def follow(self, target: Target, answer: Actuation) -> Solution:
        """As `Model.inverse`, from the nearest pose to a target beside it, where no search is needed."""


@runtime_checkable
class Compliant(Protocol):
    """A model that bends under a force on its tip."""

    def compliance(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Array:
        """Derivative of the tip position by a force on the tip, shape ``(3, 3)`` [m/N]."""


@runtime_checkable
class UnderWrenches(Protocol):
    """A model that bends under wrenches on its tip and on the end of its first section."""

    def forward_under(self, actuation: Actuation, tip: Wrench6, mid: Wrench6) -> Pose:
        """Pose under two wrenches in the base frame."""


@runtime_checkable
class Bending(Protocol):
    """A model whose sections have bends that a target may state."""

    def arcs(self, actuation: Actuation, load_n: Vec3 = ZERO3) -> Array:
        """Components u, v of the bend of every section [rad] and its length [m], shape ``(sections, 3)``."""

    def of_arcs(self, arcs: Sequence[float], seed: Actuation, load_n: Vec3 = ZERO3) -> Actuation:
        """The actuation that has these bends and lengths (`contid.targets.Target.arcs`).

        It may be outside the limits. ``seed`` is where a search begins.
        """


#: `RobotDescription.kinematics` -> "module:class"; the class is called with the robot's description.
MODELS: Final[dict[str, str]] = {
    "cosserat": "contid.kinematics.cosserat.model:CosseratModel",
    "rack_finger": "contid.kinematics.rack.finger:RackFingerModel",
    "tendon": "contid.kinematics.tendon.model:TendonModel",
    "tri_rack": "contid.kinematics.arc.section_model:SectionModel",
    "tri_tube": "contid.kinematics.arc.section_model:SectionModel",
}


def build_model(robot: RobotDescription) -> Model:
    """The model of a robot description; imports only that one, and none that has a process of its own.

    Raises:
        KernelMissingError: The kernels are not compiled in this installation.
    """
    kernels.require()
    if isinstance(robot, IsolatedRobot):
        connected: Model | None = robot.connected
        return build_model(robot.described()) if connected is None else connected
    if robot.model not in MODELS:
        built: Model = load_plugin(robot.model).build(robot)
        return built
    if robot.kinematics in MODELS:
        module, _, name = MODELS[robot.kinematics].partition(":")
        solver = getattr(import_module(module), name)
    else:
        solver = load_solver(robot, "the model")
    model: Model = solver(robot)
    if robot.reach_tolerance_mm is not None:
        tolerate(model, robot.reach_tolerance_mm / MM_PER_M)
    return model


def build_model_for_ticks(robot: RobotDescription) -> Model:
    """The model of a robot description as the control loop has it: with short searches."""
    model = build_model(robot)
    return model.for_ticks() if isinstance(model, Searching) else model
