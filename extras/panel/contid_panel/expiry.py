"""Orders of a page expire: one that waited before a panel or a daemon that stood still moves nothing later.

A page sends when something was pressed, by the clock of the panel. It learns that clock from the messages it
gets (`static/clock.js`), so clocks that differ do not matter; its estimate is never later than the press.
"""

from __future__ import annotations

from contextvars import ContextVar
from typing import Any, Final

from contid.client import AsyncClient
from contid.remote.protocol import expiry as protocol_expiry
from contid.remote.protocol.expiry import FIELD, clock_s
from contid.remote.protocol.wire import STOP_VERBS, Code, Fields, RemoteError, is_number

#: How long after its press an order is valid.
VALID_S: Final = 1.0
#: The estimate of `static/clock.js` is never ahead. A press up to this far ahead counts as one of now; one
#: further ahead is refused, because its clock is wrong.
AHEAD_S: Final = 0.25
#: Greatest time that a page may send: an integer of JSON may be larger than any float.
_LATEST_MS: Final = 1e15
#: Orders to stop: they are carried out at once, whatever else waits, and never expire.
URGENT: Final = frozenset(STOP_VERBS)
#: Orders of a page that never expire: these also only end something. They are no requests of the daemon's
#: protocol, which has no ``jog_end``; those of its requests that never expire are `protocol_expiry.LASTING`.
LASTING_ORDERS: Final = URGENT | {"release", "jog_end"}

#: Until when the order is valid that the present task carries out [s]; None: for ever.
valid_until_s: ContextVar[float | None] = ContextVar("valid_until_s", default=None)


class ExpiringClient(AsyncClient):
    """A client whose requests expire with the order of the page that they belong to."""

    async def request(self, verb: str, /, **fields: Any) -> Fields:
        """See `AsyncClient.request`; the daemon refuses it when it comes too late."""
        until_s = valid_until_s.get()
        if until_s is None or verb in protocol_expiry.LASTING:
            return await super().request(verb, **fields)
        return await super().request(verb, **fields, **{FIELD: until_s})


def clock_ms() -> int:
    """The clock of the panel, as pages learn it; rounded down, so that none is ahead."""
    return int(clock_s() * 1e3)


def validity(verb: str, pressed_ms: object) -> float | None:
    """Until when an order of a page is valid [s]; None for one that never expires.

    Args:
        verb: of the order.
        pressed_ms: when it was given, by `clock_ms`.

    Raises:
        RemoteError: it has expired, or has no time at which it was given.
    """
    if verb in LASTING_ORDERS:
        return None
    if not is_number(pressed_ms) or not abs(pressed_ms) <= _LATEST_MS:
        raise RemoteError(Code.BAD_REQUEST, f"{verb}: pressed_ms is missing, or is no time")
    now_s, pressed_s = clock_s(), pressed_ms * 1e-3
    if not now_s - VALID_S <= pressed_s <= now_s + AHEAD_S:
        age = f"{now_s - pressed_s:.1f} s ago" if pressed_s < now_s else "in the future"
        raise RemoteError(Code.EXPIRED, f"{verb} was pressed {age} and is not carried out; press it again")
    return min(pressed_s, now_s) + VALID_S
