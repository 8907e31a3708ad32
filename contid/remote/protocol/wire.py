"""Lines of the socket: newline-delimited JSON objects, their limits and their errors.

A request is ``{"id": 7, "verb": "hold", ...}``; its response has the same id and ``"ok": true`` with a
``result``, or ``"ok": false`` with an ``error`` (a code of `Code`, a message, and the faults of the robots
concerned). Objects with ``"event"`` are notices. The first line of the server is the notice ``hello``.
"""

from __future__ import annotations

import enum
import json
import re
from collections.abc import Mapping
from typing import Any, Final, TypeAlias, TypeGuard

from contid.errors import ContidError

#: Incremented when an old client would misunderstand a new server, or a new client an old server.
PROTOCOL: Final = 2
#: The orders to stop, in every protocol ``{"id": 2, "verb": "estop"}``: with ``robots`` (a list of names)
#: unless for all, with ``"end": true`` of a stop that ends the daemon, never with a version or an expiry.
STOP_VERBS: Final = ("hold", "stop", "estop")
#: Clients at a time; one more displaces the one that was idle longest.
MAX_CLIENTS: Final = 96

Fields: TypeAlias = dict[str, Any]


class Code(enum.StrEnum):
    """Why a request was refused; stable, for programs."""

    BAD_REQUEST = "bad-request"  # not JSON, not an object, a field that is missing or of the wrong type
    UNKNOWN_VERB = "unknown-verb"
    UNKNOWN_ROBOT = "unknown-robot"
    PROTOCOL = "protocol"  # client and daemon have different versions of the protocol
    FORBIDDEN = "forbidden"  # this client may only read and stop
    LEASE_HELD = "lease-held"  # another client holds the lease
    TRACKER_HELD = "tracker-held"  # another client tracks this robot
    STOPPED = "stopped"  # another client stopped the robots; acquire the lease again
    BAD_TARGET = "bad-target"  # wrong columns or numbers
    BAD_MEASUREMENT = "bad-measurement"  # wrong numbers, too old, or no tip of this robot
    UNREACHABLE = "unreachable"
    NOT_ARMED = "not-armed"
    FAULT = "fault"  # a robot concerned is in FAULT
    REFUSED = "refused"  # its state does not allow it
    NO_CREDIT = "no-credit"  # more rows than were granted
    SUPERSEDED = "superseded"  # by network: a newer row of a live stream took its place, or it was lost
    EXPIRED = "expired"  # it waited for longer than it is valid; it was not carried out
    NO_ANSWER = "no-answer"  # the control process did not confirm in time; the order was sent
    INTERNAL = "internal"  # an error of contid or its host, such as a full disk


class RemoteError(ContidError):
    """The daemon refused a request.

    Attributes:
        code: one of the codes of `Code`.
        faults: for each robot in FAULT, its number, name, cause, reaction and remedy.
    """

    def __init__(self, code: Code | str, message: str, faults: Mapping[str, Fields] | None = None) -> None:
        self.code = str(code)
        self.faults = dict(faults or {})
        super().__init__(message)
        self.exit_code = 3 if self.faults else 2

    def as_fields(self) -> Fields:
        """The ``error`` of a response."""
        fields: Fields = {"code": self.code, "message": str(self)}
        return {**fields, "faults": self.faults} if self.faults else fields

    @classmethod
    def of(cls, error: Mapping[str, Any]) -> RemoteError:
        """The exception of the ``error`` of a response."""
        return cls(str(error.get("code", "")), str(error.get("message", "")), error.get("faults"))


class NoDaemonError(ContidError):
    """No daemon runs, or more than one and none was chosen."""


class ConnectionLostError(ContidError):
    """The connection ended: the daemon ended, or disconnected this client."""


def encode(fields: Mapping[str, Any]) -> bytes:
    """One line; numbers that are not finite become null, as JSON lacks them."""
    try:
        text = json.dumps(fields, separators=(",", ":"), allow_nan=False)
    except ValueError:
        text = json.dumps(_finite(fields), separators=(",", ":"), allow_nan=False)
    return text.encode() + b"\n"


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if value - value == 0.0 else None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number in JSON")


def decode(line: bytes) -> Fields:
    """The object of one line.

    Raises:
        RemoteError: not a JSON object in UTF-8, or nested deeper than the parser goes.
    """
    try:
        fields = json.loads(line.decode("utf-8"), parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        message = str(error) or "nested too deeply"
        raise RemoteError(Code.BAD_REQUEST, f"not a JSON object: {message}") from None
    if not isinstance(fields, dict):
        raise RemoteError(Code.BAD_REQUEST, f"an object is expected, got {type(fields).__name__}")
    return fields


def is_number(value: object) -> TypeGuard[int | float]:
    """True for a number of JSON; a bool, an int in Python, is none. Some ints are too large for a float."""
    return isinstance(value, int | float) and not isinstance(value, bool)


class RequestFields:
    """The fields of a request, removed one by one with a check of their type; `end` refuses the others."""

    def __init__(self, fields: Mapping[str, Any]) -> None:
        self._fields = {key: value for key, value in fields.items() if key not in ("id", "verb")}

    def text(self, name: str, default: str) -> str:
        """A text of at most 200 characters."""
        value = self._fields.pop(name, default)
        if not isinstance(value, str) or len(value) > 200:
            raise _unexpected(name, "a text of at most 200 characters", value)
        return value

    def number(self, name: str, default: float, minimum: float, maximum: float) -> float:
        """A number in a range."""
        value = self._fields.pop(name, default)
        if not is_number(value) or not minimum <= value <= maximum:
            raise _unexpected(name, f"a number from {minimum:g} to {maximum:g}", value)
        return float(value)

    def given_number(self, name: str, minimum: float, maximum: float) -> float | None:
        """A number in a range, or None when absent or null."""
        given = self._fields.get(name) is not None
        return self.number(name, minimum, minimum, maximum) if given else self._fields.pop(name, None)

    def flag(self, name: str) -> bool:
        """True or false; false when absent."""
        value = self._fields.pop(name, False)
        if not isinstance(value, bool):
            raise _unexpected(name, "true or false", value)
        return value

    def names(self, name: str) -> tuple[str, ...] | None:
        """A list of texts, or None when absent."""
        value = self._fields.pop(name, None)
        if value is None:
            return None
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise _unexpected(name, "a list of names", value)
        return tuple(value)

    def mapping(self, name: str) -> Fields | None:
        """An object, or None when absent."""
        value = self._fields.pop(name, None)
        if value is not None and not isinstance(value, dict):
            raise _unexpected(name, "an object", value)
        return value

    def rows(self, name: str) -> list[list[float]]:
        """A list of rows of numbers."""
        value = self._fields.pop(name, None)
        if not isinstance(value, list) or not all(
            isinstance(row, list) and all(map(is_number, row)) for row in value
        ):
            raise _unexpected(name, "a list of rows of numbers", value)
        return value

    def anything(self, name: str) -> Any:
        """A field that the verb checks itself; None when absent."""
        return self._fields.pop(name, None)

    def end(self) -> None:
        """Refuse the fields that are left: a misspelt key must not be ignored."""
        if self._fields:
            raise RemoteError(Code.BAD_REQUEST, f"unknown field {', '.join(map(repr, self._fields))}")


def _unexpected(name: str, expected: str, value: object) -> RemoteError:
    return RemoteError(Code.BAD_REQUEST, f"{name}: {expected} is expected, got {repr(value)[:60]}")


#: The verb, and spellings of it without case, spaces, dots, dashes and underscores.
ESTOP: Final = "estop"
_SPELLINGS: Final = (ESTOP, "emergencystop")
_MENTION: Final = re.compile(rb"e(?:mergency)?[ ._-]{0,2}stop", re.IGNORECASE)
_VERB: Final = re.compile(
    rb"[\"']verb[\"']\s*:\s*[\"']\s*e(?:mergency)?[ ._-]{0,2}stop\s*[\"']", re.IGNORECASE
)
#: Escapes of letters and separators: in a line that is no JSON no decoder replaces them.
_ESCAPE: Final = re.compile(rb"\\u00(2[0deDE]|[46][1-9a-fA-F]|[57][0-9aA]|5[fF])")
_PUNCTUATION: Final = str.maketrans("", "", " \t\r\n._-")


def is_estop(line: bytes) -> bool:
    """True for a line that orders an emergency stop, whatever else is wrong with that line.

    A stop must not be lost for a byte-order mark, an id of another type or a number that JSON lacks. A line
    whose verb is another one is no stop though its other fields mention one, unless they contain the order
    itself, ``'verb': 'estop'`` in either quotes: it may be a repeated key or a line that lost its beginning.
    """
    if b"\\u" not in line and b"\0" not in line and b"stop" not in line.lower():
        return False  # most lines; ten times faster than the search below
    if b"\0" in line:  # UTF-16 and UTF-32
        line = line.replace(b"\0", b"")
    if b"\\u" in line:
        line = _ESCAPE.sub(lambda found: bytes((int(found[1], 16),)), line)
    mentioned = _MENTION.search(line) is not None
    if not mentioned and b"\\u" not in line:
        return False
    if _VERB.search(line):  # also when the key is repeated with another verb, or the line is cut off
        return True
    try:
        verb = decode(line).get("verb")
    except RemoteError:
        return mentioned
    if isinstance(verb, str):
        return verb.translate(_PUNCTUATION).lower() in _SPELLINGS
    return mentioned
