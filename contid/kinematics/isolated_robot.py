"""The description of a robot whose model has a process of its own: its answers, without its package.

The daemon, which has read the robot file, asks the robot's own description for everything that a
`RobotDescription` answers (`IsolatedRobot.of`). The control process gets those answers, and imports nothing
of the package that they come from.
"""

from __future__ import annotations

import pickle
from typing import Any, ClassVar, Final

from pydantic import PrivateAttr

from contid.robot_file.robot import RobotDescription
from contid.targets import Actuation


class IsolatedRobot(RobotDescription):
    """A description that was asked everything before.

    It has the keys of every robot as they are in the file; its properties are `answers`, which are made
    below the class for all that are not written out here.

    Attributes:
        answers: by the name of a property of `RobotDescription`, what the robot's own description answered.
        body: the robot's own description, pickled; only the process of its model reads it.
    """

    answers: dict[str, Any]
    body: bytes
    _model: Any = PrivateAttr(None)

    # Of the class in other descriptions; this class is that of robots of any kind.
    quantity: ClassVar[Any] = property(lambda self: self.answers["quantity"])
    dimension: ClassVar[Any] = property(lambda self: self.answers["dimension"])

    @classmethod
    def of(cls, robot: RobotDescription, body: bytes) -> IsolatedRobot:
        """The description of a robot, asked now; ``body`` is the robot, pickled."""
        keys = {name: getattr(robot, name) for name in RobotDescription.model_fields}
        answers = {name: getattr(robot, name) for name in ("quantity", "dimension", *_PROPERTIES)}
        return cls.model_construct(**keys, answers=answers, body=body)

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
        """The model that asks the process, a `contid.kinematics.model.Model`; None before `connect`."""
        return self._model

    def connect(self, model: Any) -> None:
        """Give this model to all who build one for the robot in this process."""
        self._model = model

    def described(self) -> RobotDescription:
        """The robot's own description; imports its package."""
        own: RobotDescription = pickle.loads(self.body)
        return own

    def __getstate__(self) -> dict[Any, Any]:
        """What is pickled: without the model, of which another process has none, or one of its own."""
        return {**super().__getstate__(), "__pydantic_private__": {"_model": None}}


#: Names of all that a description answers by a property, which a robot's own may define in another way.
_PROPERTIES: Final = tuple(
    name for name, value in vars(RobotDescription).items() if isinstance(value, property)
)


def _answered(name: str) -> property:
    return property(lambda self: self.answers[name])


for _name in _PROPERTIES:
    if _name not in vars(IsolatedRobot):
        setattr(IsolatedRobot, _name, _answered(_name))
