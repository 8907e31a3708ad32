"""Requests to the devices of the robots: queued, sent, answered, and kept for a bus that is lost.

A *request* asks the devices of one robot on one bus to arm, to clear a fault, or to rest (`Effect`). What a
lost bus did not answer, and what is asked meanwhile, is kept for its return as far as it takes power away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from contid.control.engine.cycle import Sink
from contid.control.engine.events.buses import BusChanged
from contid.control.engine.events.robots import OrderRefused
from contid.control.engine.ports import BusPort
from contid.control.engine.robots import Robots
from contid.control.tick.state import Effect, RobotState
from contid.control.tick.supervisor import BY_STRENGTH
from contid.hal import Rest
from contid.robot_file.base import StopPolicy

#: Requests that take the power away.
_WITHOUT_POWER: Final = (Effect.RELAX, Effect.VENT)


class DeviceRequest(NamedTuple):
    """What is asked of the devices of a robot on one bus; the robot by its index."""

    robot: int
    effect: Effect
    axes: tuple[str, ...]


class DeviceRequests:
    """The requests of a run.

    Args:
        robots: all of them.
        ports: by bus name.
        bus_of: by axis, the name of its bus.
        sink: of the events.

    Attributes:
        axes_on: by robot, its axes on each of its buses.
        queued: by bus, the requests of its next job.
    """

    def __init__(
        self, robots: Robots, ports: Mapping[str, BusPort], bus_of: Mapping[str, str], sink: Sink
    ) -> None:
        self.axes_on = [
            {
                bus: tuple(axis for axis in config.axes if bus_of[axis] == bus)
                for bus in sorted({bus_of[axis] for axis in config.axes})
            }
            for config in robots.configs
        ]
        self.queued: dict[str, list[DeviceRequest]] = {name: [] for name in ports}
        self._robots = robots
        self._ports = ports
        self._sink = sink
        #: By bus, the requests of its newest job that are not answered.
        self._sent: dict[str, tuple[DeviceRequest, ...]] = dict.fromkeys(ports, ())
        #: By bus, what was sent again after a loss and not answered yet: it may be what ends the bus.
        self._resent: dict[str, set[DeviceRequest]] = {name: set() for name in ports}
        #: By robot, the buses that have not carried out its newest request yet.
        self._outstanding: list[set[str]] = [set() for _ in robots.configs]

    def owed(self, index: int) -> StopPolicy | None:
        """The stop policy whose rest a lost bus of a robot gets when it is back; None for none."""
        asked = [
            StopPolicy(effect.name.lower())
            for name, port in self._ports.items()
            for robot, effect, _ in (self.queued[name] if port.lost else ())
            if robot == index
        ]
        return max(asked, key=BY_STRENGTH.index, default=None)

    def ask(self, index: int, state: RobotState) -> RobotState:
        """Queue the pending requests of a robot in their order; returns its state without them."""
        for effect in state.pending:
            self._queue(index, effect)
        return replace(state, pending=())

    def _queue(self, index: int, effect: Effect) -> None:
        """Queue one request of a robot; an event names each lost bus that it does not reach now."""
        lost = [bus for bus in self.axes_on[index] if self._ports[bus].lost]
        name = self._robots.configs[index].name
        if lost and effect is Effect.CLEAR:
            message = f"{name}: not cleared, {self._ports[lost[0]].lost}"
            self._sink.event(OrderRefused(robot=name, message=message))
            return
        for bus in lost:
            later = ", and it is sent if the bus comes back in this run" if effect in _WITHOUT_POWER else ""
            message = (
                f"{name}: {effect.name.lower()} does not reach its devices on {bus}, which is lost; "
                f"their own watchdog stops them{later}"
            )
            self._sink.event(BusChanged(bus=bus, message=message))
        self.send(index, effect)

    def send(self, index: int, effect: Effect) -> None:
        """Queue a request on every bus of a robot; a lost one has it when it is back if it takes power away.

        To hold is not asked then: devices whose watchdog let them vent meanwhile would close their valves.
        """
        for bus, axes in self.axes_on[index].items():
            request = DeviceRequest(index, effect, axes)
            if not self._ports[bus].lost:
                self._outstanding[index].add(bus)
            elif effect not in _WITHOUT_POWER or request in self.queued[bus]:
                continue
            self.queued[bus].append(request)

    def of_job(self, bus: str, reopens: bool = False) -> tuple[DeviceRequest, ...]:
        """The requests of the next job of a bus, which are sent now; none for one that reopens it."""
        self._sent[bus] = ()
        if not reopens:
            self._sent[bus], self.queued[bus] = tuple(self.queued[bus]), []
        return self._sent[bus]

    def rests_of(self, bus: str, busy: bool) -> list[int]:
        """Robots whose devices on a bus were asked to rest and have not answered."""
        asked = (*(self._sent[bus] if busy else ()), *self.queued[bus])
        return [each.robot for each in asked if isinstance(each.effect.value, Rest)]

    def answered(self, bus: str) -> None:
        """The requests of the newest job of a bus were answered."""
        self._resent[bus].difference_update(self._sent[bus])
        self._sent[bus] = ()

    def carried_out(self, bus: str, index: int) -> bool:
        """A bus carried out a request of a robot; True when all of its buses have done so with the newest."""
        if any(index == each.robot for each in self.queued[bus]):
            return False  # an older request of the robot: the newest one waits for the bus
        self._outstanding[index].discard(bus)
        return not self._outstanding[index]

    def refused(self, bus: str, index: int) -> None:
        """A bus does not carry out what was asked of a robot."""
        self._outstanding[index].discard(bus)

    def keep_for_return(self, bus: str) -> None:
        """A bus is lost: what was to take power away is sent again when it is back."""
        asked = _unless_armed_since((*self._sent[bus], *self.queued[bus]))
        self.queued[bus] = [each for each in asked if each not in self._resent[bus]]
        self._resent[bus].update(self.queued[bus])


def _unless_armed_since(asked: Sequence[DeviceRequest]) -> list[DeviceRequest]:
    """The requests that take power away, but for those of robots that were armed after them."""
    kept: list[DeviceRequest] = []
    for request in asked:
        if request.effect is Effect.ENABLE:
            kept = [each for each in kept if each.robot != request.robot]
        elif request.effect in _WITHOUT_POWER:
            kept.append(request)
    return kept
