"""The requests of the socket, each declared once: its verb, its lease, and its rights by network.

Whoever passes requests on derives from `REQUESTS` what it may pass: the server of the socket, the bridge of a
fleet, a page. The verb of an order is the ``NAME`` of its message (`contid.control.engine.messages`), whose
fields are those of the request and of the event in a recording.
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
class Request:
    """One request of the socket.

    Attributes:
        verb: its name.
        rights: by network it needs one of them; empty for a stop, None where it is no request by network.
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


def _stop(order: type[msg.OrderToRobots] | type[msg.Stop]) -> Request:
    return Request(order.NAME, frozenset(), stops=True, watches=True, journalled=True)


def _motion(order: type[msg.OrderToRobots] | type[msg.Grip], rights: frozenset[Right]) -> Request:
    return Request(order.NAME, rights, leased=True, journalled=True)


#: Every request of the socket by its verb.
REQUESTS: Final[Mapping[str, Request]] = {
    each.verb: each
    for each in (
        Request("hello", frozenset(Right), watches=True),
        Request("ping", _WATCH, watches=True),
        Request("status", _WATCH, watches=True),
        Request("describe", _WATCH, watches=True),
        Request("subscribe", _WATCH, watches=True),
        Request("unsubscribe", _WATCH, watches=True),
        _stop(msg.Hold),
        _stop(msg.Stop),
        _stop(msg.Estop),
        _motion(msg.Resume, _ARM),
        _motion(msg.ClearFault, _ARM),
        _motion(msg.Recover, _ARM),
        _motion(msg.Grip, _MOVE),
        Request("acquire", _MOVE | _ARM, journalled=True),
        Request("release", _MOVE | _ARM, journalled=True),
        Request("move", _MOVE, leased=True),
        Request("rows", _MOVE),
        Request("end", _MOVE),
        Request("start", _MOVE),
        Request("note", _MOVE),
        Request("measure", _MEASURE),
        Request("record"),
    )
}
