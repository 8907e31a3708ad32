"""Recognises an emergency stop in a line, whatever else is wrong with that line.

A stop must not be lost for a byte-order mark, an id of another type or a number that JSON lacks. A line whose
verb is another one is no stop, whatever its other fields contain.
"""

from __future__ import annotations

import re
from typing import Final

from contid.remote.protocol.wire import RemoteError, decode

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
    """True for a line that orders an emergency stop, well-formed or not."""
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
