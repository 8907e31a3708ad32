"""What a request from the network must be before it reaches a daemon: its key, its payload, its rights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from contid.remote.protocol.wire import Code, Fields, RemoteError, decode
from contid.units import MAX_LINE
from contid_fleet.keys import Keys, Order, Origin
from contid_fleet.rights import FEED, NEEDED, READS, STOPS, Right

#: Codes of the bridge, beside those of the socket.
FORBIDDEN: Final = "forbidden"
WILDCARD: Final = "wildcard"
#: Who stops, when the key of an emergency stop does not name it.
UNNAMED: Final = Origin("unnamed", "0")
ESTOP: Final = "estop"
#: Keys of a line of the socket that a payload must not have: the verb is that of the key.
_OF_THE_KEY: Final = ("verb", "id")


def checked(
    keys: Keys, key: str, payload: bytes, operators: Mapping[str, Sequence[Right]]
) -> tuple[Order, Fields]:
    """A request and its fields.

    An emergency stop is never refused: what cannot be read of it is left out, and it then stops every robot.

    Raises:
        RemoteError: the request is refused.
    """
    order = keys.order(key)
    if key.rpartition("/")[2] == ESTOP:
        order = order or Order(None, UNNAMED, ESTOP)
        try:
            return order, _fields(payload)
        except RemoteError:
            return order, {}
    if order is None:
        raise RemoteError(
            WILDCARD, f"{key[:200]}: only the node may be a wildcard, and only to stop or to read"
        )
    if order.node is None and order.verb not in STOPS | READS | {FEED}:
        raise RemoteError(WILDCARD, f"{order.verb}: a request to every node may only stop or read")
    rights = NEEDED.get(order.verb)
    if rights is None:
        raise RemoteError(Code.UNKNOWN_VERB, f"{order.verb!r} is no request by network")
    if rights and not rights & {*operators.get(order.origin.operator, ())}:
        needs = " or ".join(sorted(rights))
        message = f"{order.verb}: operator {order.origin.operator!r} needs the right {needs} on this machine"
        raise RemoteError(FORBIDDEN, message)
    fields = _fields(payload)
    if order.verb == "stop" and fields.get("end"):
        raise RemoteError(FORBIDDEN, "a daemon is not ended by network")
    return order, fields


def _fields(payload: bytes) -> Fields:
    if len(payload) > MAX_LINE - 256:  # room for the number and the verb
        raise RemoteError(Code.BAD_REQUEST, f"a request has at most {MAX_LINE - 256} bytes")
    fields = decode(payload) if payload else {}
    found = [name for name in _OF_THE_KEY if name in fields]
    if found:
        raise RemoteError(Code.BAD_REQUEST, f"{found[0]}: it is part of the key, and not of the payload")
    return fields
