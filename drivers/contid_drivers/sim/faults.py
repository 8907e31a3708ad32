"""Faults of a simulated bus, scheduled by the robot file, and the journal of its events."""

from __future__ import annotations

import heapq
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from contid.errors import DeviceError
from contid.hal import DeviceKind
from contid_drivers.sim.devices import SimDevice
from contid_drivers.sim.options import FaultKind, ScheduledFault


@dataclass(frozen=True, slots=True, order=True)
class Edge:
    """Begin or end of a fault; ``number`` keeps edges of one instant in the order of the file."""

    time_s: float
    number: int
    on: bool
    fault: ScheduledFault = field(compare=False)

    @property
    def kind(self) -> FaultKind:
        """Of the fault."""
        return self.fault.kind

    @property
    def axis(self) -> str:
        """Of the fault, "" for the bus."""
        return self.fault.axis or ""


class Switches:
    """Scheduled edges of faults, and the faults that are on.

    Attributes:
        on: additional delay of replies [s] of every fault that is on, by kind and axis, "" for the bus.
    """

    def __init__(self) -> None:
        self._edges: list[Edge] = []
        self._number = 0
        self.on: dict[tuple[FaultKind, str], float] = {}

    def schedule(self, fault: ScheduledFault, origin_s: float) -> None:
        """Schedule begin and end of a fault; its times count from ``origin_s``."""
        begin = origin_s + fault.at_s
        ends = [] if fault.for_s is None else [(begin + fault.for_s, False)]
        for time_s, on in [(begin, True), *ends]:
            self._number += 1
            heapq.heappush(self._edges, Edge(time_s, self._number, on, fault))

    @property
    def next_s(self) -> float:
        """Time of the next edge, infinity for none."""
        return self._edges[0].time_s if self._edges else float("inf")

    def take(self) -> Edge:
        """Remove the next edge, apply and return it."""
        edge = heapq.heappop(self._edges)
        if edge.on:
            self.on[edge.kind, edge.axis] = edge.fault.delay_ms / 1e3
        else:
            self.on.pop((edge.kind, edge.axis), None)
        return edge

    def is_on(self, kind: FaultKind, axis: str = "") -> bool:
        """True while the fault is on."""
        return (kind, axis) in self.on

    @property
    def delay_s(self) -> float:
        """Additional delay of replies now."""
        return self.on.get((FaultKind.LATE, ""), 0.0)


def append_event(
    path: str, event: str, t_s: float, bus: str, devices: Mapping[str, SimDevice], subject: str
) -> None:
    """Append one event with the state of every axis, as one JSON line.

    It takes one system call, so that a killed process leaves whole lines; they show what the devices did
    after the control process ended.

    Raises:
        DeviceError: the file cannot be written.
    """
    line = {
        "event": event,
        "t_s": t_s,
        "bus": bus,
        "subject": subject,
        "axes": {name: _state(device) for name, device in devices.items()},
    }
    try:
        with Path(path).open("ab", buffering=0) as file:
            file.write(json.dumps(line).encode() + b"\n")
    except OSError as error:
        raise DeviceError(bus, f"cannot write journal_file {path}: {error.strerror}") from error


def _state(device: SimDevice) -> dict[str, object]:
    unit = "pa" if device.kind is DeviceKind.REGULATOR else "rad"
    return {
        f"value_{unit}": device.motion.value,
        f"goal_{unit}": device.goal,
        "on": device.on,
        "rest": "" if device.on else device.rest.value,
        "fault": device.fault,
    }
