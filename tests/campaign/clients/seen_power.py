"""What must hold of torque, by the journals of devices: on after an order to arm, off after a stop."""

from __future__ import annotations

from collections.abc import Iterator

from contid.control.engine.tick_layout import ENABLED
from contid.control.tick.supervisor import Mode
from tests.campaign.clients.seen import Seen

#: Orders that arm robots, and orders after which only those arm them.
ARMS = frozenset({"resume", "recover"})


def power(seen: Seen) -> Iterator[str]:
    """Devices obey commands only after an order to arm that no stop followed."""
    for robot, config in seen.configs.items():
        given = [
            (seen.times[seen.at[tick]] if tick in seen.at else -1.0, order["order"])
            for tick, order in seen.for_robot(robot) if order["order"] in {*ARMS, "estop", "stop", "finish"}
        ]  # fmt: skip
        for note in seen.notes:
            axes = set(note["subject"].split(", ")) & set(config.axes)
            if note["event"] != "enable" or not axes:
                continue
            before = [what for at_s, what in given if at_s <= note["t_s"]]
            # A bus that takes longer than a tick is still at the requests of the one before; it rests next.
            soon = any(
                each["event"] == "disable" and axes & set(each["subject"].split(", "))
                and 0.0 <= each["t_s"] - note["t_s"] < 0.2 for each in seen.notes
            )  # fmt: skip
            if before and before[-1] not in ARMS and not soon:
                yield f"{robot}: {sorted(axes)} enabled at {note['t_s']:.4f} after {before[-3:]}"


def rest(seen: Seen) -> Iterator[str]:
    """A robot that is OFF has devices at rest, and one that was stopped by an estop has no torque."""
    last_s = seen.times[-1] + 1.0
    for robot, config in seen.configs.items():
        given = seen.for_robot(robot)
        for number, (tick, order) in enumerate(given):
            if order["order"] != "estop" or tick not in seen.at:
                continue
            arms = [t for t, o in given[number + 1 :] if o["order"] in ARMS]
            end_s = seen.times[seen.at[arms[0]]] if arms and arms[0] in seen.at else last_s
            place = next(
                (
                    at for at in range(seen.at[tick], len(seen.records))
                    if all(seen.valid(robot, min(k, len(seen.records) - 1)) for k in range(at, at + 2))
                ),
                None,
            )  # fmt: skip
            if place is None:
                continue
            begin_s = (
                seen.end_s(place)
                if place == seen.at[tick]
                else seen.end_s(min(place + 1, len(seen.records) - 1))
            )
            for axis in config.axes:
                for at_s, state in seen.states(axis, begin_s, end_s):
                    if state["on"] or state["rest"] not in ("relax", "vent"):
                        now = "on" if state["on"] else state["rest"]
                        yield f"{axis} is {now} at {at_s:.4f} ({state['event']}) after the estop at {tick}"
                        break
        for place in range(1, len(seen.records) - 2):
            record = seen.records[place].robots[seen.places[robot]]
            mode = Mode(record.mode)
            idle = mode is Mode.OFF or (mode is Mode.FAULT and not record.flags & ENABLED)
            if not idle or not all(seen.valid(robot, place + k) for k in (-1, 0, 1)):
                continue
            after = seen.records[place + 1].robots[seen.places[robot]]
            if after.mode != record.mode or after.flags & ENABLED:
                continue
            policies = (config.stops.on_fault, config.stops.on_interrupt)
            if any(policy.value not in ("relax", "vent") for policy in policies):
                continue  # devices that hold may be on
            found = [
                axis for axis in config.axes
                for at_s, state in [*seen.states(axis, seen.end_s(place), seen.end_s(place) + 1e-9)][:1]
                if state["on"]
            ]  # fmt: skip
            if found:
                yield f"{', '.join(found)} on while {robot} is {mode.name} at tick {seen.records[place].tick}"
                break
