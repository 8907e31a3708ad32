"""What an operator may ask by network: the rights of the fleet file over the verbs of the socket.

Stops need no right, `hello`, `clock` and `feed` any. Verbs that are not listed are refused, and so is the end
of a daemon.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from contid.control.orders import REQUESTS
from contid.control.orders import Right as Right

#: Allowed without a right, also in a request to every node.
STOPS: Final = frozenset(verb for verb, request in REQUESTS.items() if request.stops)
#: Requests that change nothing; also to every node.
READS: Final = frozenset({"status", "describe"})
#: The conductor of a run relates the clock of a node to its own.
NOTE: Final = "note"
#: Verbs that need the lease: at the daemon some take a free one by themselves. An order that waited in a
#: bridge that stood still must not do that.
LEASED: Final = frozenset(verb for verb, request in REQUESTS.items() if request.leased)
#: Begins a client: names it, and answers what the daemon is.
GREETING: Final = "hello"
#: Answered by the bridge itself, in the thread of the network: the clocks of its machine.
CLOCK: Final = "clock"
#: Answered there as well: the operator whose feed a machine needs is present. It may go to every node.
FEED: Final = "feed"
#: Rights of which a verb needs one; none for a stop. Verbs that are not listed are no requests by network.
NEEDED: Final[Mapping[str, frozenset[Right]]] = {
    **dict.fromkeys((CLOCK, FEED), frozenset(Right)),
    **{verb: request.rights for verb, request in REQUESTS.items() if request.rights is not None},
}


def allowed_verbs(rights: frozenset[Right]) -> tuple[str, ...]:
    """Verbs that rights allow, stops included, sorted."""
    return tuple(sorted(verb for verb, needed in NEEDED.items() if not needed or needed & rights))
