"""Fault switches of an emulated bus, by call and by a control file.

Each switch is an `InjectedFault`; as JSON it is one line appended to the control file::

    {"fault": "drop", "id": 3, "count": 2}      the next two answers of servo 3 never arrive
    {"fault": "delay", "id": 3, "ms": 4}        every answer of servo 3 is 4 ms late, until ms is 0
    {"fault": "corrupt", "id": 3, "count": 1}   a flipped bit in its next answer
    {"fault": "duplicate", "id": 3}             its next answer arrives twice
    {"fault": "echo", "on": true}               the adapter returns what the host sends
    {"fault": "silent", "id": 3, "on": true}    no reception and no answers until "on": false
    {"fault": "alert", "id": 3, "bits": 4}      hardware error status; 4 is overheated
    {"fault": "overload", "id": 3}              the same with bits 32, which drops the torque
    {"fault": "brownout"}                       every servo resets; with an id, only that one
    {"fault": "trip", "id": 3}                  Bus Watchdog trip
    {"fault": "late", "ms": 5}                  the adapter delivers everything 5 ms late, until ms is 0
    {"fault": "latency", "ms": 16}              it delivers at multiples of 16 ms only (latency timer)
    {"fault": "chunks", "count": 7}             it delivers pieces of 7 bytes, until count is 0
    {"fault": "hiccup", "ms": 50}               nothing for 50 ms, then everything at once
    {"fault": "host", "hz": 20}                 a second host reads positions at 20 Hz, until hz is 0
    {"fault": "jam", "id": 3, "on": true}       its shaft is blocked; the current rises to its limit
    {"fault": "freeze", "id": 3, "on": true}    its encoder reports the same position for ever
    {"fault": "push", "id": 3, "degrees": 30, "ms": 500}  a hand turns its shaft; under torque it resists
    {"fault": "snap", "id": 3}                  its tendon breaks; with "on": false it is tied again
    {"fault": "tube", "on": false}              a tendon robot is taken out of the tube that holds it straight
    {"fault": "unplug"}                         the port disappears
    {"fault": "replug", "port": "servos2.pty"}  and returns, under another name if one is given

Refused lines are appended with their error to the file's name plus ``.errors``.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, field
from typing import Any, Final

from contid.errors import ContidError
from contid_drivers.dynamixel.emulator.adapter import Adapter

_KEYS: Final[dict[str, tuple[str, ...]]] = {
    "drop": ("id", "count"),
    "delay": ("id", "ms"),
    "corrupt": ("id", "count"),
    "duplicate": ("id", "count"),
    "echo": ("on",),
    "silent": ("id", "on"),
    "alert": ("id", "bits"),
    "overload": ("id",),
    "brownout": ("id",),
    "trip": ("id",),
    "late": ("ms",),
    "latency": ("ms",),
    "chunks": ("count",),
    "hiccup": ("ms",),
    "host": ("hz",),
    "jam": ("id", "on"),
    "freeze": ("id", "on"),
    "push": ("id", "degrees", "ms"),
    "snap": ("id", "on"),
    "tube": ("on",),
    "unplug": (),
    "replug": ("port",),
}
_NEED_ID: Final = {
    "drop",
    "delay",
    "corrupt",
    "duplicate",
    "silent",
    "alert",
    "overload",
    "trip",
    "jam",
    "freeze",
    "push",
    "snap",
}


class FaultSyntaxError(ContidError):
    """An invalid fault switch."""


@dataclass(frozen=True, slots=True)
class InjectedFault:
    """One fault switch; a kind ignores fields it does not use."""

    kind: str
    device: int | None = None
    count: int = 1
    ms: float = 0.0
    hz: float = 0.0
    bits: int = 0x04
    on: bool = True
    degrees: float = 0.0
    port: str | None = None

    def __post_init__(self) -> None:
        """Check kind and id."""
        if self.kind not in _KEYS:
            raise FaultSyntaxError(f"no fault {self.kind!r}; faults: {', '.join(_KEYS)}")
        if self.kind in _NEED_ID and self.device is None:
            raise FaultSyntaxError(f"fault {self.kind!r} needs an id")

    @classmethod
    def parse(cls, line: str) -> InjectedFault:
        """Decode one line of a control file.

        Raises:
            FaultSyntaxError: no JSON object, no such fault, or a key the fault does not have.
        """
        try:
            given: Any = json.loads(line)
        except json.JSONDecodeError as error:
            raise FaultSyntaxError(f"fault switch is not JSON: {error}") from None
        if not isinstance(given, dict) or not isinstance(given.get("fault"), str):
            raise FaultSyntaxError('a fault switch is an object with a key "fault"')
        kind = given.pop("fault")
        if unknown := set(given) - set(_KEYS.get(kind, given)):
            raise FaultSyntaxError(
                f"fault {kind!r} has no {', '.join(sorted(unknown))}; it has {_KEYS[kind]}"
            )
        return cls(kind, given.pop("id", None), **given)


@dataclass(slots=True)
class FaultSwitches:
    """Faults of the answers of a bus that are on.

    Attributes:
        echo: the adapter returns what the host sends.
        second_host_hz: rate at which a second host reads positions; 0 for none.
        adapter: late, batched or chunked delivery.
        silent: ids that neither receive nor answer.
        delay_s: additional delay of answers, by id.
        drop, corrupt, duplicate: number of the next answers with this fault, by id.
    """

    echo: bool = False
    second_host_hz: float = 0.0
    adapter: Adapter = field(default_factory=Adapter)
    silent: set[int] = field(default_factory=set)
    delay_s: dict[int, float] = field(default_factory=dict)
    drop: dict[int, int] = field(default_factory=dict)
    corrupt: dict[int, int] = field(default_factory=dict)
    duplicate: dict[int, int] = field(default_factory=dict)

    def set(self, fault: InjectedFault) -> bool:
        """Set a fault of the answers; False for faults of servos or of the port."""
        device = fault.device if fault.device is not None else -1
        if fault.kind == "echo":
            self.echo = fault.on
        elif fault.kind == "silent":
            (self.silent.add if fault.on else self.silent.discard)(device)
        elif fault.kind == "delay":
            self.delay_s[device] = fault.ms / 1e3
        elif fault.kind in ("drop", "corrupt", "duplicate"):
            counts: dict[int, int] = getattr(self, fault.kind)
            counts[device] = fault.count
        elif fault.kind == "host":
            self.second_host_hz = fault.hz
        else:
            return self._set_adapter(fault)
        return True

    def _set_adapter(self, fault: InjectedFault) -> bool:
        match fault.kind:
            case "late":
                self.adapter.late_s = fault.ms / 1e3
            case "latency":
                self.adapter.latency_s = fault.ms / 1e3
            case "chunks":
                self.adapter.chunk = fault.count
            case "hiccup":
                self.adapter.stalled_until = time.monotonic() + fault.ms / 1e3
            case _:
                return False
        return True

    def spent(self, kind: str, device: int) -> bool:
        """Whether the next answer of a servo has this fault; decrements its count."""
        counts: dict[int, int] = getattr(self, kind)
        if not counts.get(device):
            return False
        counts[device] -= 1
        return True
