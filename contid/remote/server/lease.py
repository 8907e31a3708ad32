"""The right to move: at most one client has it, and only while it shows that it is alive.

Pure bookkeeping with the time given; the server acts on what it returns. The input of the daemon (stdin or
--trajectory) has the right before any client until it ends or somebody takes over.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from contid.remote.protocol.wire import Code, Fields, RemoteError

#: Seconds without a request of its holder after which the right is lost, unless asked for otherwise.
TIMEOUT_S: Final = 2.0
LEAST_TIMEOUT_S: Final = 0.1
GREATEST_TIMEOUT_S: Final = 60.0
#: The name of the daemon's own input as a holder.
INPUT: Final = "input"


@dataclass(slots=True)
class LeaseHolder:
    """Who has the right.

    Attributes:
        client: its number; 0 is the daemon's input.
        name: what it calls itself.
        since_s: when it took it.
        timeout_s: after how long without a request it loses it.
        seen_s: its last request.
    """

    client: int
    name: str
    since_s: float
    timeout_s: float
    seen_s: float


class Lease:
    """Who may move the robots.

    Attributes:
        holder: who has it, None while nobody has.
        stopped_by: who took it away with a stop; then it must be taken explicitly again.
    """

    def __init__(self, now_s: float, input_active: bool) -> None:
        self.holder: LeaseHolder | None = None
        self.stopped_by = ""
        if input_active:
            self.holder = LeaseHolder(0, INPUT, now_s, float("inf"), now_s)

    def held_by(self, client: int) -> bool:
        """True when this client has it."""
        return self.holder is not None and self.holder.client == client

    @property
    def input_holds(self) -> bool:
        """True while the daemon's own input has it."""
        return self.held_by(0)

    def refresh(self, client: int, now_s: float) -> None:
        """The client made a request."""
        if self.holder is not None and self.holder.client == client:
            self.holder.seen_s = now_s

    def take(
        self, client: int, name: str, now_s: float, timeout_s: float = TIMEOUT_S, takeover: bool = False
    ) -> LeaseHolder | None:
        """Take the right; returns the holder it was taken from.

        Raises:
            RemoteError: somebody else has it and ``takeover`` is not set.
        """
        before = self.holder
        if before is not None and before.client != client and not takeover:
            raise self.refusal(now_s)
        self.stopped_by = ""
        since_s = now_s if before is None or before.client != client else before.since_s
        self.holder = LeaseHolder(client, name, since_s, timeout_s, now_s)
        return before if before is not None and before.client != client else None

    def use(self, client: int, name: str, now_s: float) -> None:
        """Make sure that a client may move: it has the right, or takes it because it is free.

        Raises:
            RemoteError: somebody else has it, or a stop took it away.
        """
        if self.held_by(client):
            return
        if self.holder is None and self.stopped_by:
            message = f"{self.stopped_by} stopped the robots; look, then take the motion right to go on"
            raise RemoteError(Code.STOPPED, message)
        self.take(client, name, now_s)

    def allow(self, client: int, now_s: float) -> None:
        """Make sure that a client may resume or clear: nobody else, except the input, has the right.

        Raises:
            RemoteError: another client has it.
        """
        if self.holder is not None and self.holder.client not in (0, client):
            raise self.refusal(now_s)
        self.stopped_by = ""

    def revoke(self, by: int, message: str) -> LeaseHolder | None:
        """A stop by somebody else takes the right from a client; the input keeps it, it only pauses."""
        holder = self.holder
        if holder is None or holder.client in (0, by):
            return None
        self.holder, self.stopped_by = None, message
        return holder

    def release(self, client: int) -> bool:
        """Give it back; True when the client had it."""
        if not self.held_by(client):
            return False
        self.holder = None
        return True

    def expired(self, now_s: float) -> LeaseHolder | None:
        """The holder that has not been heard of for too long; it has lost the right."""
        holder = self.holder
        if holder is None or now_s - holder.seen_s <= holder.timeout_s:
            return None
        self.holder = None
        return holder

    def refusal(self, now_s: float) -> RemoteError:
        """Who has the right, and how to get it."""
        assert self.holder is not None
        name = "the daemon's own input" if self.holder.client == 0 else f"client {self.holder.name!r}"
        since_s = now_s - self.holder.since_s
        return RemoteError(
            Code.HELD,
            f"{name} has the motion right since {since_s:.1f} s; take it over explicitly (takeover)",
        )

    def as_fields(self, now_s: float) -> Fields:
        """For ``status``."""
        holder = self.holder
        if holder is None:
            return {"holder": None, "stopped_by": self.stopped_by or None}
        return {"holder": holder.name, "client": holder.client, "since_s": round(now_s - holder.since_s, 3)}
