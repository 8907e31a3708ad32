"""The expiry of a request: one that waited too long before a process that stood still moves nothing later.

A request may carry the time until which it is valid, on a clock that all processes of the machine share and
that goes on while the machine sleeps. Orders to stop never expire.
"""

from __future__ import annotations

import time
from typing import Final

from contid.control.orders import REQUESTS
from contid.remote.protocol.wire import STOP_VERBS, Code, Fields, RemoteError, is_number

#: The field of a request.
FIELD = "valid_until_s"
#: Requests that never expire: they only end something.
LASTING: Final = frozenset({*STOP_VERBS, "end", "release"})


def clock_s() -> float:
    """The time that `FIELD` refers to [s]: since the machine was started, sleep included."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def check_expiry(verb: str, fields: Fields) -> Fields:
    """The fields of a request without `FIELD`.

    Raises:
        RemoteError: it is no order to stop, and has expired.
    """
    rest = {name: value for name, value in fields.items() if name != FIELD}
    if len(rest) == len(fields) or REQUESTS[verb].stops:
        return rest
    until_s = fields[FIELD]
    if not is_number(until_s):
        raise RemoteError(Code.BAD_REQUEST, f"{FIELD}: a number is expected, got {str(until_s)[:40]!r}")
    late_s = clock_s() - until_s
    if late_s > 0.0:
        raise RemoteError(Code.EXPIRED, f"{verb} came {late_s:.1f} s too late and was not carried out")
    return rest
