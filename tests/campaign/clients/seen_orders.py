"""What must hold of orders: answers (by `tests.remote.orders.history`), onsets of motion, ends of moves."""

from __future__ import annotations

import math
from collections.abc import Iterator

from contid.control.tick.config import RobotConfig
from tests.campaign.clients.seen import Seen
from tests.remote.orders.history import GOES, LEFT, MOVING, STOPS, History, Order


class _Lease(History):
    """The lease alone; states are judged here, robot by robot."""

    def _may_be_held(self, order: Order) -> bool:
        """Also by a move under way: it holds the lease up to its answer, also if that refuses."""
        return super()._may_be_held(order) or any(
            each.verb == "move" and each.ok is False and each.client != order.client
            and each.sent < order.answered and each.answered > order.sent for each in self.orders
        )  # fmt: skip

    def _states(self, order: Order) -> Iterator[str]:
        return iter(())

    def _onsets(self) -> Iterator[str]:
        return iter(())


def _with_ticks(seen: Seen) -> None:
    for order in seen.case.orders:
        order.sent_tick = seen.tick_at(order.sent)
        order.answered_tick = math.inf if order.answered == math.inf else seen.tick_at(order.answered)


def answers(seen: Seen) -> Iterator[str]:
    """Every order is answered once, with the states of the tick it names; the lease is kept."""
    _with_ticks(seen)
    orders = sorted(seen.case.orders, key=lambda each: each.sent)
    last_s = seen.times[-1]
    for order in orders:
        # The daemon ended before it answered.
        if order.ok is None and order.client not in seen.case.closed:
            seen.case.closed[order.client] = last_s
    lease = _Lease(orders, {}, seen.case.closed)  # type: ignore[arg-type]
    if seen.case.input:
        yield from (each for each in lease.wrong() if "never answered" in each)
    else:
        yield from lease.wrong()
    for order in orders:
        if (
            order.ok is None
            and order.sent < last_s - 3.0
            and (seen.case.closed.get(order.client, math.inf) > order.sent + 3.5)
        ):
            yield f"no answer within 3.5 s: {order}"
        if order.code == "no-answer":
            yield f"not confirmed: {order} {order.result}"
        if order.ok is False and not order.result.get("message", "").strip():
            yield f"refused without a reason: {order}"
        tick, robots = order.result.get("tick"), order.result.get("robots")
        if isinstance(tick, int) and tick in seen.at:
            if not order.sent_tick <= tick <= order.answered_tick:
                yield f"foreign tick {tick}: {order}"
            if isinstance(robots, dict):
                modes = {name: seen.mode(name, seen.at[tick]) for name in robots}
                if modes != robots:
                    yield f"foreign states: {order}, {order.result}; the record has {modes}"
            if order.ok and order.verb in STOPS:
                yield from _obeyed(seen, order, tick)
        if order.ok and order.verb == "clear_fault":
            for name, mode in order.result["robots"].items():
                if name in order.result["cleared"] and mode == "FAULT":
                    yield f"cleared, and in FAULT: {order} {order.result}"


def _obeyed(seen: Seen, order: Order, tick: int) -> Iterator[str]:
    """A stop that was answered is in the recording in its tick, and its robots do what was ordered."""
    named = order.fields.get("robots")
    mine = [
        o for t, o in seen.given
        if tick - 20 <= t <= tick and o["order"] == order.verb
        and (None if o.get("robots") is None else set(o["robots"])) == (None if named is None else set(named))
    ]  # fmt: skip
    if not mine:
        yield f"answered, and not recorded at {tick}: {order}"
    refused = order.result.get("refused", {})
    for name, mode in order.result["robots"].items():
        if name in refused:
            continue
        later = [o for t, o in seen.for_robot(name) if t == tick and o["order"] != order.verb]
        if later:
            continue  # other orders of the same tick
        allowed = {
            "estop": {"OFF", "FAULT"}, "stop": {"OFF", "FAULT", "STOPPING"},
            "hold": {"OFF", "HOLD", "FAULT", "READY", "CONNECTING", "ARMING", "STOPPING"},
        }[order.verb]  # fmt: skip
        if mode not in allowed:
            yield f"{name} is {mode} after {order}"


def _touches(order: Order, robot: str) -> bool:
    named = order.fields.get("robots")
    if order.verb == "move":
        columns = [*order.fields.get("target", ()), *order.fields.get("columns", ())]
        return any(column.startswith(f"{robot}.") for column in columns)
    return named is None or robot in named


def onsets(seen: Seen) -> Iterator[str]:
    """A robot begins to move by an order that no stop has ended, and never by itself."""
    if seen.case.input:
        return
    orders = sorted(seen.case.orders, key=lambda each: each.sent)
    lease = _Lease(orders, {}, seen.case.closed)  # type: ignore[arg-type]
    for robot in seen.configs:
        goes = [o for o in orders if o.verb in GOES and o.ok is not False and _touches(o, robot)]
        stops = [o for o in orders if o.verb in STOPS and o.ok and _touches(o, robot)]
        before = "ARMING"  # the run arms them at its start
        armed = False
        for place, record in enumerate(seen.records):
            mode = seen.mode(robot, place)
            if mode in MOVING and before not in MOVING and armed:
                stopped = max([s.sent for s in stops if s.result["tick"] < record.tick], default=-1.0)
                authors = [
                    o for o in goes
                    if o.sent_tick <= record.tick and o.answered > stopped
                    and not (o.ok is None and record.tick > seen.tick_at(
                        seen.case.closed.get(o.client, math.inf)) + LEFT)
                    and lease.bar(o) is None
                ]  # fmt: skip
                if not authors:
                    yield f"{robot}: {before} to {mode} at {record.tick} without an order"
            armed = armed or mode not in ("OFF", "CONNECTING", "READY", "ARMING")
            before = mode


def moves(seen: Seen) -> Iterator[str]:
    """A move ends once, and one that reached its target did so by command and by measurement."""
    begun = {
        (o.client, o.result["move"]): o for o in seen.case.orders
        if o.ok and o.verb == "move" and "move" in o.result
    }  # fmt: skip
    ended: dict[tuple[int, int], int] = {}
    for client, notice in seen.case.notices:
        key = (client, notice["move"])
        ended[key] = ended.get(key, 0) + 1
        order = begun.get(key)
        if order is None or not notice["reached"] or "target" not in order.fields:
            continue
        place = seen.at[seen.tick_at(notice["at_s"])]
        for robot in seen.configs:
            if not _touches(order, robot):
                continue
            yield from _reached(seen, robot, order, place)
    for key, count in ended.items():
        if count > 1:
            yield f"move {key} ended {count} times"
    last_s = seen.times[-1]
    for key, order in begun.items():
        late = last_s - order.answered > 8.0 and seen.case.closed.get(order.client, math.inf) > last_s - 0.5
        if key not in ended and late and "target" in order.fields:
            yield f"no end of {order}"


def _reached(seen: Seen, robot: str, order: Order, place: int) -> Iterator[str]:
    """In one of the ticks before the notice the robot was measured at the target."""
    config = seen.configs[robot]
    goal = {k.split(".", 1)[1]: v for k, v in order.fields["target"].items() if k.startswith(f"{robot}.")}
    best = math.inf
    for at in range(max(0, place - 80), place + 1):
        record = seen.records[at].robots[seen.places[robot]]
        values = [axis.value for axis in record.axes]
        if any(map(math.isnan, values)):
            continue
        measured = config.transmission.to_actuation(values)
        best = min(best, off_target(config, measured, goal))
    if best > (3.0 if "x_mm" in goal else 0.05):
        yield f"{robot}: {order} reached, measured {best:.3g} off at best"


def off_target(config: RobotConfig, actuation: tuple[float, ...], goal: dict[str, float]) -> float:
    if "x_mm" in goal:
        x, y, _ = config.frame.point_in_world(config.model.forward(actuation).tip_m)
        return math.hypot(1e3 * x - goal["x_mm"], 1e3 * y - goal["y_mm"])
    return max(abs(value / 1e5 - want) for value, want in zip(actuation, goal.values(), strict=True))
