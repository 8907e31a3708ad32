"""What an operator may ask by network: the rights of the fleet file over the verbs of the socket.

Stops need no right, `hello`, `clock` and `feed` any. Verbs that are not listed are refused, and so is the end
of a daemon.
"""

from __future__ import annotations

import enum
from typing import Final


class Right(enum.StrEnum):
    """A right of an operator in the file of a machine."""

    WATCH = "watch"
    MEASURE = "measure"
    MOVE = "move"
    ARM = "arm"


#: Allowed without a right, also in a request to every node.
STOPS: Final = frozenset({"hold", "stop", "estop"})
#: Requests that change nothing; also to every node.
READS: Final = frozenset({"status", "describe"})
#: The conductor of a run relates the clock of a node to its own.
NOTE: Final = "note"
#: The right that a verb needs.
VERBS: Final = {
    **dict.fromkeys(READS, Right.WATCH),
    **dict.fromkeys(("ping", "subscribe", "unsubscribe"), Right.WATCH),
    "measure": Right.MEASURE,
    **dict.fromkeys(("acquire", "release", "move", "rows", "end", "start", NOTE, "grip"), Right.MOVE),
    **dict.fromkeys(("resume", "recover", "clear_fault"), Right.ARM),
}
#: Verbs that need the lease: at the daemon some take a free one by themselves. An order that waited in a
#: bridge that stood still must not do that.
LEASED: Final = frozenset({"move", "grip", "resume", "recover", "clear_fault"})
#: Begins a client: names it, and answers what the daemon is.
GREETING: Final = "hello"
#: Answered by the bridge itself, in the thread of the network: the clocks of its machine.
CLOCK: Final = "clock"
#: Answered there as well: the operator whose feed a machine needs is present. It may go to every node.
FEED: Final = "feed"
#: Verbs for which any right suffices.
UNRESTRICTED: Final = frozenset({GREETING, CLOCK, FEED})
#: Verbs of the lease itself.
LEASE: Final = frozenset({"acquire", "release"})


def needed(verb: str) -> frozenset[Right] | None:
    """Rights of which one suffices; empty for a stop, None for a verb that no right allows."""
    if verb in STOPS:
        return frozenset()
    if verb in UNRESTRICTED:
        return frozenset(Right)
    if verb in LEASE:
        return frozenset({Right.MOVE, Right.ARM})
    return frozenset({VERBS[verb]}) if verb in VERBS else None


def allowed_verbs(rights: frozenset[Right]) -> tuple[str, ...]:
    """Verbs that rights allow, stops included, sorted."""
    verbs = {verb for verb in (*VERBS, *UNRESTRICTED) if (needed(verb) or frozenset()) & rights}
    return tuple(sorted(verbs | STOPS))
