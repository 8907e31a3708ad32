"""One case through the real engine in virtual time, and everything that was seen on the way."""

from __future__ import annotations

from dataclasses import dataclass, field

from contid.control.engine import messages as msg
from contid.control.engine.cycle import OnEnd
from contid.control.engine.events import RunEvent
from contid.control.engine.events.run import StopBegan
from contid.control.engine.tick_layout import TickRecord
from contid.control.engine.virtual import VirtualProcess
from contid.control.engine.wiring import record_layout
from contid.hal import Bus
from contid_drivers.sim.bus import SimBus
from contid_drivers.sim.options import SimBusOptions
from tests.campaign.script import Case
from tests.support.sim_faults import advance

#: However long a stop takes by itself, a run that does not end so much later is taken as stuck.
STUCK_S = 2.0


@dataclass
class Seen:
    """What a run left behind; also the sink of its engine.

    Attributes:
        case: what was run.
        records: of every tick.
        events: in order.
        powered: per tick the axes whose device obeys commands, read from the device itself.
        lost: per tick the buses that are gone.
        finished: the engine came to its end by itself.
        skipped: ticks skipped.
        powered_at_end: axes still obeying after the host was gone for longer than any watchdog time.
    """

    case: Case
    records: list[TickRecord] = field(default_factory=list)
    events: list[RunEvent] = field(default_factory=list)
    powered: list[frozenset[str]] = field(default_factory=list)
    lost: list[frozenset[str]] = field(default_factory=list)
    finished: bool = False
    skipped: int = 0
    powered_at_end: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        self._layout = record_layout(self.case.machine.loaded, self.case.machine.rate_hz)

    def write(self, values: list[float]) -> None:
        self.records.append(self._layout.decode(tuple(values)))

    def event(self, event: RunEvent) -> None:
        self.events.append(event)

    def modes(self) -> dict[str, list[int]]:
        """States of every robot, by tick of the record."""
        return {
            config.name: [record.robots[index].mode for record in self.records]
            for index, config in enumerate(self.case.machine.configs)
        }


def _powered(buses: dict[str, Bus]) -> frozenset[str]:
    out = set()
    for bus in buses.values():
        assert isinstance(bus, SimBus)
        out |= {axis for axis, device in bus.devices.items() if device.on}
    return frozenset(out)


def watch(case: Case) -> Seen:
    """Run a case to its end."""
    seen = Seen(case)
    rate_hz = case.machine.rate_hz
    process = VirtualProcess(
        case.loaded(), rate_hz, seen, trajectory=case.trajectory, on_end=OnEnd.HOLD, attended=True
    )
    buses = dict(process.buses)
    given, give_up = 0, None
    try:
        if case.armed:
            process.engine.arm()
        while not process.engine.finished and (give_up is None or process.tick < give_up):
            process.begin()
            for before in range(given, process.tick + 1):
                for message in case.orders.get(before, ()):
                    process.engine.obey(message, process.tick)
                    if isinstance(message, msg.Finish):
                        stopping = next(e for e in reversed(seen.events) if isinstance(e, StopBegan))
                        give_up = process.tick + round((stopping.seconds + STUCK_S) * rate_hz)
            given = process.tick + 1
            if case.dies_at is not None and process.tick >= case.dies_at:
                break
            process.turn()
            seen.powered.append(_powered(buses))
            seen.lost.append(frozenset(name for name, port in process.ports.items() if port.lost))
        seen.finished, seen.skipped = process.engine.finished, process.skipped
        # From here on no tick refreshes the watchdogs.
        longest_s = (
            max(
                bus.options.watchdog_ms
                for bus in case.machine.loaded.buses.values()
                if isinstance(bus.options, SimBusOptions)
            )
            / 1e3
        )
        process.clock.sleep(longest_s + 1.0 / rate_hz)
        for bus in buses.values():
            assert isinstance(bus, SimBus)
            advance(bus)
        seen.powered_at_end = _powered(buses)
    finally:
        process.close()
    return seen
