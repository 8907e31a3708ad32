"""What a run may have done with the orders of its clients: a model of docs/remote.md, apart from the server.

It sees what clients see: when an order was sent and answered, the answer, and the states of all ticks. Orders
overlap, so only what is certain counts: an order was carried out at some time between its two times, a stop
stands from its answer on, and it may be lifted by every order that may have been carried out after it.
``python -m tests.remote.orders.socket_races`` makes such histories.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

STOPS: Final = frozenset({"hold", "stop", "estop"})
#: Orders that let robots move.
GOES: Final = frozenset({"resume", "recover", "move", "rows", "end", "start"})
#: Of those, orders that may be refused for a stop of another client, or for the lease, and for nothing else.
BARRED: Final = frozenset({"resume", "recover", "move", "acquire"})
MOVING: Final = frozenset({"ARMING", "APPROACH", "RUN"})
OFF: Final = frozenset({"OFF", "FAULT"})
#: Ticks until an estop without an answer has been obeyed, and until an order of a client that left has begun.
WITHIN: Final = 50
LEFT: Final = 100
#: A lease is certain for as long as its holder asked for, less what a busy machine takes [s].
CERTAIN_S: Final = 30.0


@dataclass(slots=True, eq=False)
class Order:
    """One order of a client, and its answer.

    Attributes:
        client: its number; a client that comes back is another one.
        verb, fields: as sent; a malformed ``estop`` is one.
        sent, sent_tick: number of the event, and newest tick, when it was sent.
        answered, answered_tick: the same of its answer; never, if its client left.
        ok: None without an answer.
        code: of a refusal.
        result: of an answer.
    """

    client: int
    verb: str
    fields: Mapping[str, Any]
    sent: int
    sent_tick: int
    answered: float = math.inf
    answered_tick: float = math.inf
    ok: bool | None = None
    code: str = ""
    result: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        answer = "no answer" if self.ok is None else "ok" if self.ok else self.code
        where = f"{self.sent}-{self.answered}, ticks {self.sent_tick}-{self.answered_tick}"
        return f"client {self.client} {self.verb} {dict(self.fields)} ({where}): {answer}"

    @property
    def stops(self) -> bool:
        """It stopped all robots, also as a malformed estop that was then refused."""
        return self.verb == "estop" or (self.verb in STOPS and self.ok is True)

    @property
    def lifts(self) -> bool:
        """It lifts the stops of all clients, if it was carried out."""
        acquires = self.verb == "acquire" and not self.fields.get("unless_stopped")
        return self.ok is not False and (acquires or bool(self.fields.get("after_stop")))

    @property
    def goes(self) -> bool:
        """It may have let robots move."""
        return self.verb in GOES and self.ok is not False


class History:
    """Orders and states of a run.

    Attributes:
        orders: in the order in which they were sent.
        modes: state by robot, by tick.
        closed: number of the event at which a client left, by client.
    """

    def __init__(
        self, orders: Sequence[Order], modes: Mapping[int, Mapping[str, str]], closed: Mapping[int, int]
    ) -> None:
        self.orders, self.modes, self.closed = orders, modes, closed
        clients = {order.client for order in orders}
        self._stops = {c: [o for o in orders if o.client == c and o.stops] for c in clients}
        self._all_stops = [order for order in orders if order.verb in STOPS]
        self._lifters = [order for order in orders if order.lifts]
        self._goes = {c: [o for o in orders if o.client == c and o.goes] for c in clients}
        self._acquired = {
            c: [o for o in orders if o.client == c and o.ok and o.verb == "acquire"] for c in clients
        }

    def wrong(self) -> Iterator[str]:
        """Everything that the docs exclude."""
        for order in self.orders:
            if order.ok is None and order.client not in self.closed:
                yield f"never answered: {order}"
            if order.ok and order.verb in GOES and (stop := self.bar(order)):
                yield f"moved after a stop: {order} after {stop}"
            if order.ok and order.verb in GOES and (holder := self.holder(order)):
                yield f"moved without the lease: {order}, held by {holder}"
            if order.code == "stopped" and order.verb in BARRED and not self._may_be_stopped(order):
                yield f"refused though no stop stands: {order}"
            if order.code == "lease-held" and not self._may_be_held(order):
                yield f"refused though the lease is free: {order}"
            yield from self._states(order)
        yield from self._onsets()

    def bar(self, order: Order) -> Order | None:
        """The stop of another client that certainly stood when an order was carried out."""
        if order.fields.get("after_stop"):
            return None
        for client, stops in self._stops.items():
            before = [stop for stop in stops if stop.answered < order.sent]
            if client == order.client or not before:
                continue
            stop = before[-1]
            lifters = (*self._lifters, *self._goes[client])
            if not any(each.answered > stop.sent and each.sent < order.answered for each in lifters):
                return stop
        return None

    def holder(self, order: Order) -> Order | None:
        """The ``acquire`` of another client that certainly held the lease when an order was carried out."""
        for client, acquired in self._acquired.items():
            before = [each for each in acquired if each.answered < order.sent]
            if client == order.client or not before or client in self.closed:
                continue
            found = before[-1]
            if found.fields.get("timeout_s", 0.0) < CERTAIN_S:
                continue
            ended = (
                each
                for each in self.orders
                if each.answered > found.sent and each.sent < order.answered and each.ok is not False
                if (each.client == client and each.verb == "release")
                or (each.client != client and (each.verb in STOPS or each.fields.get("takeover")))
            )
            refused = (each for each in self._all_stops if each.ok is False and each.client != client)
            late = any(each.answered > found.sent and each.sent < order.answered for each in refused)
            if not late and next(ended, None) is None:
                return found
        return None

    def _may_be_stopped(self, order: Order) -> bool:
        """Some stop of another client may stand: nothing certainly lifted it."""
        others = [s for s in self._all_stops if s.client != order.client and s.sent < order.answered]
        sure = [each for each in self._lifters if each.ok and each.answered < order.sent]
        return any(not any(each.sent > stop.answered for each in sure) for stop in others)

    def _may_be_held(self, order: Order) -> bool:
        """Some other client may hold the lease: nothing certainly ended it."""
        takers = [
            each
            for each in self.orders
            if each.client != order.client and each.sent < order.answered and each.ok is not False
            if each.verb == "acquire" or each.goes
        ]
        for taker in takers:
            ends = (
                each
                for each in self.orders
                if each.ok and each.sent > taker.answered and each.answered < order.sent
                if (each.client == taker.client and each.verb == "release")
                or (each.client != taker.client and (each.verb in STOPS or each.fields.get("takeover")))
            )
            if next(ends, None) is None:
                return True
        return False

    def _states(self, order: Order) -> Iterator[str]:
        """The states of an answer are those of the tick it names; an estop is obeyed."""
        tick, robots = order.result.get("tick"), order.result.get("robots")
        if isinstance(tick, int):
            if not order.sent_tick <= tick <= order.answered_tick:
                yield f"answered with a foreign tick: {order}, {order.result}"
            if isinstance(robots, Mapping) and robots != self.modes[tick]:
                yield f"answered with foreign states: {order}, {order.result}, {self.modes[tick]}"
        if order.verb == "estop":
            first, last = order.sent_tick, order.sent_tick + WITHIN
            if order.ok is not None:
                last = int(min(order.answered_tick, last))
            obeyed = any(tick in self.modes and self._off(tick) for tick in range(first, last + 1))
            # An order to go on that overlaps may have been obeyed after it, in the same tick.
            goes = (each for some in self._goes.values() for each in some)
            if not obeyed and not any(g.sent < order.answered and g.answered > order.sent for g in goes):
                yield f"an estop was lost: {order}"

    def _off(self, tick: int) -> bool:
        return {*self.modes[tick].values()} <= OFF

    def _onsets(self) -> Iterator[str]:
        """Robots begin to move by an order that was not barred, and that no stop has ended."""
        goes = sorted((o for each in self._goes.values() for o in each), key=lambda o: o.sent_tick)
        sent = [order.sent_tick for order in goes]
        stops = sorted((s for s in self._all_stops if s.ok), key=lambda stop: stop.result["tick"])
        obeyed = [stop.result["tick"] for stop in stops]
        latest: list[int] = []  # of the stops obeyed before a tick, the last one that was sent
        for stop in stops:
            latest.append(max(stop.sent, latest[-1] if latest else 0))
        held, before = False, None
        for tick, modes in sorted(self.modes.items()):
            begins = before is not None and any(
                mode in MOVING and before[robot] not in MOVING for robot, mode in modes.items()
            )
            if begins and held:
                count = bisect.bisect_left(obeyed, tick)
                stopped = latest[count - 1] if count else -1
                authors = goes[: bisect.bisect_right(sent, tick)]
                if not any(self._began(each, tick, stopped) for each in reversed(authors)):
                    yield f"began to move in tick {tick} without an order: {before}, {modes}"
            held, before = held or {*modes.values()} == {"HOLD"}, modes

    def _began(self, order: Order, tick: int, stopped: int) -> bool:
        left = order.ok is None and tick > order.answered_tick + LEFT
        return order.answered > stopped and not left and self.bar(order) is None
