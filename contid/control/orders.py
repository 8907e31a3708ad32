"""The requests of the socket, each declared once: its verb, its lease, and its rights by network.

The server of the socket, the bridge of a fleet and a page derive from `REQUESTS` what they may pass on. The
verb of an order is the ``NAME`` of its message (`contid.control.engine.messages`), whose fields are those of
the request and of the event in a recording.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from contid.control.engine import messages as msg


class Right(enum.StrEnum):
    """What an operator may do by network; the file of a machine grants it."""

    WATCH = "watch"
    MEASURE = "measure"
    MOVE = "move"
    ARM = "arm"


@dataclass(frozen=True, slots=True)
class SocketRequest:
    """One request of the socket.

    Attributes:
        verb: its name.
        rights: rights, one of which a client by network needs; empty for a stop, None where it is no request
            by network.
        stops: it stops robots: every client may give it, and it needs no lease.
        watches: also a client that may only watch may ask it.
        leased: it needs the lease. Some requests take a free one at the daemon, which one that waited in a
            bridge must not do.
        journalled: it is logged when a client speaks for another.
    """

    verb: str
    rights: frozenset[Right] | None = None
    stops: bool = False
    watches: bool = False
    leased: bool = False
    journalled: bool = False


_WATCH, _MEASURE = frozenset({Right.WATCH}), frozenset({Right.MEASURE})
_MOVE, _ARM = frozenset({Right.MOVE}), frozenset({Right.ARM})


def _stop(order: type[msg.OrderToRobots] | type[msg.Stop]) -> SocketRequest:
    return SocketRequest(order.NAME, frozenset(), stops=True, watches=True, journalled=True)


def _motion(order: type[msg.OrderToRobots] | type[msg.Grip], rights: frozenset[Right]) -> SocketRequest:
    return SocketRequest(order.NAME, rights, leased=True, journalled=True)


#: Every request of the socket by its verb.
REQUESTS: Final[Mapping[str, SocketRequest]] = {
    each.verb: each
    for each in (
        SocketRequest("hello", frozenset(Right), watches=True),
        SocketRequest("ping", _WATCH, watches=True),
        SocketRequest("status", _WATCH, watches=True),
        SocketRequest("describe", _WATCH, watches=True),
        SocketRequest("subscribe", _WATCH, watches=True),
        SocketRequest("unsubscribe", _WATCH, watches=True),
        _stop(msg.Hold),
        _stop(msg.Stop),
        _stop(msg.Estop),
        _motion(msg.Resume, _ARM),
        _motion(msg.ClearFault, _ARM),
        _motion(msg.Recover, _ARM),
        _motion(msg.Grip, _MOVE),
        SocketRequest("acquire", _MOVE | _ARM, journalled=True),
        SocketRequest("release", _MOVE | _ARM, journalled=True),
        SocketRequest("move", _MOVE, leased=True),
        SocketRequest("rows", _MOVE),
        SocketRequest("end", _MOVE),
        SocketRequest("start", _MOVE),
        SocketRequest("note", _MOVE),
        SocketRequest("measure", _MEASURE),
        SocketRequest("record"),
    )
}
