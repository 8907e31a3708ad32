"""Keys of a fleet on the network: ``contid/FLEET/NODE/...`` and ``contid/FLEET/who/OPERATOR/SESSION``.

The operator is part of the key of an order, so that access rules bind it to a certificate. So is the session:
each program of an operator has a local connection, and a lease, of its own.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

ROOT: Final = "contid"
#: Names of fleets, nodes, operators and sessions: no wildcard and no separator of Zenoh.
NAME: Final = r"[a-z0-9._-]{1,40}"
NAME_RULE: Final = "1 to 40 of a-z, 0-9, dot, dash and underscore"
_NAME: Final = re.compile(NAME)
#: Chunks beside the nodes of a fleet.
RESERVED: Final = frozenset({"who"})


def is_name(text: str) -> bool:
    """True for a name that may be a chunk of a key."""
    return _NAME.fullmatch(text) is not None


def is_node_name(text: str) -> bool:
    """True for a name that a node may have."""
    return is_name(text) and text not in RESERVED


@dataclass(frozen=True, slots=True)
class Origin:
    """Who asks: an operator, and one of its programs."""

    operator: str
    session: str


@dataclass(frozen=True, slots=True)
class Order:
    """The key of a request: ``contid/FLEET/NODE/do/OPERATOR/SESSION/VERB``.

    Attributes:
        node: its name; None for every node (``*``).
        origin: who asks.
        verb: verb of the socket.
    """

    node: str | None
    origin: Origin
    verb: str


@dataclass(frozen=True, slots=True)
class Keys:
    """The keys of one fleet."""

    fleet: str

    def alive(self, node: str, bridge: str) -> str:
        """The token of a node; two for one node are a mistake."""
        return f"{ROOT}/{self.fleet}/{node}/alive/{bridge}"

    def telemetry(self, node: str) -> str:
        """Telemetry of a node, as the lines of the socket."""
        return f"{ROOT}/{self.fleet}/{node}/telemetry"

    def event(self, node: str) -> str:
        """Events of a node, as the lines of the socket."""
        return f"{ROOT}/{self.fleet}/{node}/event"

    def notices(self, node: str, operator: str, session: str = "*") -> str:
        """Notices of the local connection of a session: moves that ended, a lease that was lost."""
        return f"{ROOT}/{self.fleet}/{node}/notices/{operator}/{session}"

    def do(self, node: str, operator: str, session: str, verb: str) -> str:
        """A request; each part may be ``*``."""
        return f"{ROOT}/{self.fleet}/{node}/do/{operator}/{session}/{verb}"

    def who(self, operator: str, session: str) -> str:
        """The token of a session of an operator."""
        return f"{ROOT}/{self.fleet}/who/{operator}/{session}"

    def order(self, key: str) -> Order | None:
        """The parts of the key of a request; None when it is none, or has a wildcard beyond the node."""
        chunks = key.split("/")
        if len(chunks) != 7 or chunks[:2] != [ROOT, self.fleet] or chunks[3] != "do":
            return None
        node, operator, session, verb = chunks[2], *chunks[4:]
        if not all(map(is_name, (operator, session, verb))) or not (node == "*" or is_node_name(node)):
            return None
        return Order(None if node == "*" else node, Origin(operator, session), verb)

    def origin(self, key: str) -> Origin | None:
        """The session of a token; None when the key is none."""
        chunks = key.split("/")
        if len(chunks) != 5 or chunks[:3] != [ROOT, self.fleet, "who"] or not all(map(is_name, chunks[3:])):
            return None
        return Origin(chunks[3], chunks[4])

    def alive_node(self, key: str) -> tuple[str, str] | None:
        """Node and bridge of a token; None when the key is none."""
        chunks = key.split("/")
        if len(chunks) != 5 or chunks[:2] != [ROOT, self.fleet] or chunks[3] != "alive":
            return None
        return (chunks[2], chunks[4]) if is_node_name(chunks[2]) else None

    def answer(self, key: str, node: str) -> str:
        """The key of a node's answer to a question: other wildcards of its key are filled in."""
        chunks = [chunk if "*" not in chunk else "any" for chunk in key.split("/")]
        if len(chunks) > 2:
            chunks[2] = node
        return "/".join(chunks)

    def node(self, key: str) -> str:
        """The node of any key below one."""
        return key.split("/")[2]
