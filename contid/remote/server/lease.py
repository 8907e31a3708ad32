"""The lease: the exclusive, expiring permission of one client to move the robots.

This class only keeps the state; times are arguments [s, monotonic], and
`contid.remote.server.request_handler` acts on the results.
While stdin or ``--trajectory`` moves the robots, that input holds the lease as `INPUT_CLIENT`. After a stop
other clients move again only after an explicit ``acquire``, or a ``resume`` with ``after_stop``: a script in
a loop does not undo the stop of a person, and neither does a stop of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from contid.remote.protocol.wire import Code, Fields, RemoteError

#: Seconds without a request of the holder after which the lease lapses, unless the holder chose another time.
TIMEOUT_S: Final = 2.0
MIN_TIMEOUT_S: Final = 0.1
MAX_TIMEOUT_S: Final = 60.0
#: The number and the name of the daemon's own input as a holder.
INPUT_CLIENT: Final = 0
INPUT: Final = "input"
#: Most stops that are kept; the newest makes way for another. Two of different clients bar every client.
MAX_STOPS: Final = 8


@dataclass(slots=True)
class LeaseHolder:
    """The client that holds the lease.

    Attributes:
        client: its number; `INPUT_CLIENT` is the daemon's input.
        name: its name in messages.
        by: the person or program for whom the client orders, "" for itself.
        since_s: time of acquisition.
        timeout_s: the lease lapses after this time without a request.
        seen_s: time of its last request.
    """

    client: int
    name: str
    since_s: float
    timeout_s: float
    seen_s: float
    by: str = ""

    @property
    def label(self) -> str:
        """For messages."""
        return client_label(self.name, self.by)


@dataclass(frozen=True, slots=True, eq=False)
class ClientStop:
    """One stop of a client: who stopped the robots and how. A later one of the same client is another one."""

    message: str


def client_label(name: str, by: str) -> str:
    """A client in messages: its name, and for whom it orders."""
    return f"client {name!r} by {by!r}" if by else f"client {name!r}"


class Lease:
    """The state of the lease.

    Attributes:
        holder: None while the lease is free.
    """

    def __init__(self, now_s: float, input_active: bool) -> None:
        self.holder: LeaseHolder | None = None
        #: By client; each stop stands until `end_stop`.
        self._stops: dict[int, ClientStop] = {}
        if input_active:
            self.holder = LeaseHolder(INPUT_CLIENT, INPUT, now_s, float("inf"), now_s)

    def held_by(self, client: int) -> bool:
        """True when this client holds the lease."""
        return self.holder is not None and self.holder.client == client

    def refresh(self, client: int, now_s: float) -> None:
        """Note a request of a client."""
        if self.holder is not None and self.holder.client == client:
            self.holder.seen_s = now_s

    def acquire(
        self,
        client: int,
        name: str,
        now_s: float,
        timeout_s: float = TIMEOUT_S,
        takeover: bool = False,
        by: str = "",
        unless_stopped: bool = False,
    ) -> LeaseHolder | None:
        """Acquire the lease; returns the previous holder if it was another one.

        No stop stands any more, but with ``unless_stopped`` the client's own stands until it moves.

        Raises:
            RemoteError: another client holds it and ``takeover`` is not set, or stopped the robots and
                ``unless_stopped`` is set.
        """
        before = self.holder
        if before is not None and before.client != client and not takeover:
            raise self._refusal(before, now_s)
        if unless_stopped:
            self._check_stopped(client)
        else:
            self._stops.clear()
        since_s = now_s if before is None or before.client != client else before.since_s
        self.holder = LeaseHolder(client, name, since_s, timeout_s, now_s, by)
        return before if before is not None and before.client != client else None

    def require(self, client: int, name: str, now_s: float, by: str = "") -> ClientStop | None:
        """Ensure that a client may move: it holds the lease, or acquires a free one.

        Returns:
            Its own stop; it stands, for the others, until the client moves (`end_stop`).

        Raises:
            RemoteError: another client holds it, or stopped the robots.
        """
        self.check_free(client, now_s, input_counts=True)
        self._check_stopped(client)
        if not self.held_by(client):
            self.holder = LeaseHolder(client, name, now_s, TIMEOUT_S, now_s, by)
        return self._stops.get(client)

    def allow(self, client: int, now_s: float, after_stop: bool) -> Mapping[int, ClientStop]:
        """Ensure that a client may resume robots, ``after_stop`` although another client stopped them.

        Returns:
            The stops that stand, each for `end_stop` once robots have resumed.

        Raises:
            RemoteError: another client (but the input) holds the lease, or stopped the robots.
        """
        self.check_free(client, now_s)
        if not after_stop:
            self._check_stopped(client)
        return dict(self._stops)

    def check_free(self, client: int, now_s: float, input_counts: bool = False) -> None:
        """Refuse a client while another one (with ``input_counts`` also the input) holds the lease."""
        holder = self.holder
        if holder is not None and holder.client != client and (holder.client or input_counts):
            raise self._refusal(holder, now_s)

    def _check_stopped(self, client: int) -> None:
        """Refuse a client while a stop by another one stands; a client may go on after its own stop."""
        others = [stop.message for stopper, stop in self._stops.items() if stopper != client]
        if others:
            message = f"{'; '.join(others)} stopped the robots; check them, then acquire the lease to go on"
            raise RemoteError(Code.STOPPED, f"{message} (`contid resume`)")

    @property
    def stopped_by(self) -> str:
        """Who stopped the robots, "" when they may be moved again."""
        return "; ".join(stop.message for stop in self._stops.values())

    def end_stop(self, client: int, stop: ClientStop | None) -> None:
        """A stop of a client does not stand any more, because it moves; a later one of it does."""
        if stop is not None and self._stops.get(client) is stop:
            del self._stops[client]

    def stop(self, by: int, message: str) -> LeaseHolder | None:
        """Note a stop; revokes the lease of another client, the input keeps it and pauses.

        It removes no stop of another client, but the newest of `MAX_STOPS`.

        Returns:
            The holder that lost the lease.
        """
        self._stops.pop(by, None)
        if len(self._stops) == MAX_STOPS:
            self._stops.popitem()
        self._stops[by] = ClientStop(message)
        holder = self.holder
        if holder is None or holder.client in (INPUT_CLIENT, by):
            return None
        self.holder = None
        return holder

    def release(self, client: int) -> bool:
        """Release the lease; True when the client held it."""
        if not self.held_by(client):
            return False
        self.holder = None
        return True

    def expire(self, now_s: float) -> LeaseHolder | None:
        """Free a lapsed lease; returns its former holder."""
        holder = self.holder
        if holder is None or now_s - holder.seen_s <= holder.timeout_s:
            return None
        self.holder = None
        return holder

    def as_fields(self, now_s: float) -> Fields:
        """The field ``lease`` of ``status``."""
        holder = self.holder
        if holder is None:
            return {"holder": None, "stopped_by": self.stopped_by or None}
        since_s = round(now_s - holder.since_s, 3)
        found: Fields = {"holder": holder.name, "client": holder.client, "since_s": since_s}
        if self._stops:
            found["stopped_by"] = self.stopped_by
        return {**found, "by": holder.by} if holder.by else found

    @staticmethod
    def _refusal(holder: LeaseHolder, now_s: float) -> RemoteError:
        name = "the daemon's own input" if holder.client == INPUT_CLIENT else holder.label
        held_s = now_s - holder.since_s
        message = f"{name} has held the lease for {held_s:.1f} s; set takeover to acquire it all the same"
        return RemoteError(Code.LEASE_HELD, message)
