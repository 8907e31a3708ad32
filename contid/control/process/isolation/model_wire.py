"""Messages between the control process and the process of a model: JSON, and raw numbers for arrays.

    question  whether with short searches, the method, its arguments
    answer    JSON: what it is, its fields | zero byte | the numbers of an array

JSON keeps every number of Python to the bit, and an answer makes nothing but values: a class of a foreign
package that it might name is not imported.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, Final, NamedTuple

import numpy as np

from contid.control.process.isolation.wire import HEAD, LONGEST, LONGEST_TEXT
from contid.targets import Pose, Solution, Target

#: What a model may be asked, and what it answers: the methods of `Model`, `Bending`, `Compliant` and
#: `UnderWrenches`.
ANSWERS: Final[dict[str, str]] = {
    "forward": "pose",
    "inverse": "solution",
    "shape": "array",
    "jacobian": "array",
    "compliance": "array",
    "arcs": "array",
    "of_arcs": "numbers",
    "forward_under": "pose",
}
_TARGET: Final = tuple(field.name for field in fields(Target))
_RECORDS: Final[dict[str, type[Pose] | type[Solution]]] = {"pose": Pose, "solution": Solution}
_FIELDS: Final = {kind: tuple(field.name for field in fields(record)) for kind, record in _RECORDS.items()}


class ModelRaisedError(Exception):
    """An error of a model in another process; raised as a class of the name that the error has there.

    It is also of the kind of that error which is in `_KINDS`: who catches it there catches it here.
    """


#: Kinds of errors that are kept, the first that fits.
_KINDS: Final[tuple[type[Exception], ...]] = (ValueError, ArithmeticError, LookupError, TypeError)


class ModelQuestion(NamedTuple):
    """A question.

    Attributes:
        brief: to the model with short searches (`contid.kinematics.model.Searching`).
        method: name of the method.
        arguments: of the call.
    """

    brief: bool
    method: str
    arguments: Sequence[Any]

    def pack(self) -> bytes:
        """The message."""
        arguments = self.arguments
        if self.method == "inverse":
            target, seed = arguments
            arguments = ([getattr(target, name) for name in _TARGET], seed)
        return _packed([self.brief, self.method, arguments])

    @classmethod
    def unpack(cls, message: bytes) -> ModelQuestion:
        """Of a message."""
        brief, method, packed = json.loads(message)
        arguments = [_tuples(each) for each in packed]
        if method == "inverse":
            arguments[0] = Target(*arguments[0])
        return cls(brief, method, arguments)


def pack_answer(method: str, answer: Any) -> bytes:
    """The message of what a method answered; of an error, where it is nothing that the method may answer."""
    kind = ANSWERS[method]
    try:
        numbers = b""
        if kind == "array":
            array = np.ascontiguousarray(answer, dtype=float)
            content, numbers = [*array.shape], array.tobytes()
        elif kind == "numbers":
            content = [*answer]
        else:
            if not isinstance(answer, _RECORDS[kind]):
                raise TypeError(f"the model answered {answer!r}, not a {kind}")
            content = [getattr(answer, name) for name in _FIELDS[kind]]
        message = _packed([kind, content])
        if kind == "array":
            message += b"\0" + numbers
        if len(message) > LONGEST - HEAD.size:
            raise ValueError(f"the model answered {len(message)} bytes")
        return message
    except Exception as error:
        return pack_error(error)


def pack_error(error: BaseException) -> bytes:
    """The message of an error."""
    try:
        text = str(error)[:LONGEST_TEXT]
    except Exception as other:  # its own text is a defect
        text = f"its message: {type(other).__name__}"
    kind = next((kind.__name__ for kind in _KINDS if isinstance(error, kind)), "")
    return _packed(["error", [type(error).__name__, text, kind]])


def unpack_answer(message: bytes) -> Any:
    """What a method answered.

    Raises:
        ModelRaisedError: an error instead.
    """
    head, _, numbers = message.partition(b"\0")
    kind, content = json.loads(head)
    match kind:
        case "error":
            name, text, kind = content
            kinds = [each for each in _KINDS if each.__name__ == kind]
            raise type(name, (ModelRaisedError, *kinds), {})(text)
        case "array":
            return np.frombuffer(numbers).reshape(content).copy()
        case "numbers":
            return _tuples(content)
        case _:
            return _RECORDS[kind](*map(_tuples, content))


def _tuples(value: Any) -> Any:
    """The same with tuples for lists: JSON has no tuples."""
    if not isinstance(value, list):
        return value
    return tuple([_tuples(each) if isinstance(each, list) else each for each in value])


def _plain(value: Any) -> Any:
    """Numbers and arrays of NumPy, and mappings, as values of Python."""
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"the model answered {value!r}")


_ENCODER: Final = json.JSONEncoder(default=_plain)


def _packed(value: Any) -> bytes:
    return _ENCODER.encode(value).encode()
