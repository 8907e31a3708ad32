"""The description of a robot whose model has a process of its own: its answers, without its package."""

from __future__ import annotations

import pickle
from typing import Any, ClassVar, Final

from pydantic import PrivateAttr

from contid.robot_file.robot import RobotDescription
from contid.targets import Actuation


class IsolatedRobot(RobotDescription):
    """A description that was asked everything before; who reads it imports nothing of its package.

    Attributes:
        answers: of every property of the robot's own description, and of its class, by name.
        body: the robot's own description, pickled; only the process of its model reads it.
    """

    answers: dict[str, Any]
    body: bytes
    _model: Any = PrivateAttr(None)

    quantity: ClassVar[Any] = property(lambda self: self.answers["quantity"])
    dimension: ClassVar[Any] = property(lambda self: self.answers["dimension"])

    @classmethod
    def of(cls, robot: RobotDescription, body: bytes) -> IsolatedRobot:
        """The description of a robot, asked now."""
        values = {name: getattr(robot, name) for name in RobotDescription.model_fields}
        answers = {name: getattr(robot, name) for name in ("quantity", "dimension", *_PROPERTIES)}
        return cls.model_construct(**values, answers=answers, body=body)

    @property
    def axis_names(self) -> tuple[str, ...]:
        """See `RobotDescription.axis_names`."""
        return tuple(self.answers["axis_names"])

    @property
    def lower(self) -> Actuation:
        """See `RobotDescription.lower`."""
        return tuple(self.answers["lower"])

    @property
    def upper(self) -> Actuation:
        """See `RobotDescription.upper`."""
        return tuple(self.answers["upper"])

    @property
    def connected(self) -> Any:
        """The `contid.kinematics.model.Model` that asks a process, for all who build one; None without."""
        return self._model

    def connect(self, model: Any) -> None:
        """Have `connected` return a model."""
        self._model = model

    def described(self) -> RobotDescription:
        """The robot's own description; imports its package."""
        own: RobotDescription = pickle.loads(self.body)
        return own

    def __getstate__(self) -> dict[Any, Any]:
        """Without the model: another process has none, or one of its own."""
        return {**super().__getstate__(), "__pydantic_private__": {"_model": None}}


#: Everything that a model's own description may answer in another way.
_PROPERTIES: Final = tuple(
    name for name, value in vars(RobotDescription).items() if isinstance(value, property)
)


def _answered(name: str) -> property:
    return property(lambda self: self.answers[name])


for _name in _PROPERTIES:
    if _name not in vars(IsolatedRobot):
        setattr(IsolatedRobot, _name, _answered(_name))
