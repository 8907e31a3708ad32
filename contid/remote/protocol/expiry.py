"""The expiry of a request: one that waited too long before a process that stood still moves nothing later.

A request may carry the time until which it is valid, on a clock that all processes of the machine share and
that goes on while the machine sleeps. Orders to stop never expire. The work for one may take longer, as the
check of a large trajectory does, but not because the daemon stood still: `unpaused`.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from contextvars import ContextVar
from typing import Final

from contid.control.orders import REQUESTS
from contid.remote.protocol.wire import STOP_VERBS, Code, Fields, RemoteError, is_number

#: The field of a request.
FIELD = "valid_until_s"
#: Requests that never expire: they only end something.
LASTING: Final = frozenset({*STOP_VERBS, "release"})
#: Greatest time that a request may have [s].
_LATEST_S: Final = 1e12
#: Time between two looks at the clock, and the time from which on nothing ran between them [s].
LOOK_S: Final = 0.1
STOOD_S: Final = 0.5

#: Until when the request is valid that the present task serves [s]; None: for ever.
_valid_until_s: ContextVar[float | None] = ContextVar("_valid_until_s", default=None)


def clock_s() -> float:
    """The time that `FIELD` refers to [s]: since the machine was started, sleep included."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def check_expiry(verb: str, fields: Fields) -> Fields:
    """The fields of a request without `FIELD`.

    The end of a live stream only ends it; that of a timed trajectory plays it, and is checked by `unpaused`.

    Raises:
        RemoteError: it is no order to stop, and has expired.
    """
    _valid_until_s.set(None)
    rest = {name: value for name, value in fields.items() if name != FIELD}
    if len(rest) == len(fields) or REQUESTS[verb].stops:
        return rest
    until_s = fields[FIELD]
    if not is_number(until_s) or not abs(until_s) <= _LATEST_S:
        raise RemoteError(Code.BAD_REQUEST, f"{FIELD}: a time [s] is expected, got {str(until_s)[:40]!r}")
    _valid_until_s.set(until_s)
    if verb != "end":
        _check(verb, until_s)
    return rest


def check_still_valid(verb: str) -> None:
    """Check again, once the request under way has waited for others of its client.

    Raises:
        RemoteError: it has expired.
    """
    until_s = _valid_until_s.get()
    if until_s is not None and verb != "end":
        _check(verb, until_s)


@asynccontextmanager
async def unpaused(verb: str) -> AsyncIterator[Callable[[], None]]:
    """A check during the work for the request under way, to be called before anything is sent that moves.

    Raises:
        RemoteError: here, that it has expired; by the check, that it has, and the daemon stood still.
    """
    until_s = _valid_until_s.get()
    if until_s is None:
        yield lambda: None
        return
    _check(verb, until_s)
    looked_s, stood = clock_s(), False

    def look() -> None:
        nonlocal looked_s, stood
        before_s, looked_s = looked_s, clock_s()
        stood |= looked_s - before_s > STOOD_S and looked_s > until_s

    async def watch() -> None:
        while True:
            await asyncio.sleep(LOOK_S)
            look()

    def check() -> None:
        look()
        if stood:
            _check(verb, until_s)

    watching = asyncio.create_task(watch())
    try:
        yield check
    finally:
        watching.cancel()


def _check(verb: str, until_s: float) -> None:
    late_s = clock_s() - until_s
    if late_s > 0.0:
        raise RemoteError(Code.EXPIRED, f"{verb} came {late_s:.1f} s too late and was not carried out")
