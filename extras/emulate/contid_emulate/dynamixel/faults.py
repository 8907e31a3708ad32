"""Fault switches of an emulated bus, by call and by a control file.

Each switch is an `InjectedFault`; as JSON it is one line appended to the control file::

    {"fault": "drop", "id": 3, "count": 2}      the next two answers of servo 3 never arrive
    {"fault": "delay", "id": 3, "ms": 4}        every answer of servo 3 is 4 ms late, until ms is 0
    {"fault": "corrupt", "id": 3, "count": 1}   a flipped bit in its next answer
    {"fault": "duplicate", "id": 3}             its next answer arrives twice
    {"fault": "misread", "id": 3, "count": 2}   it receives the next two instructions damaged: CRC error
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
    {"fault": "share", "id": 3, "share": 0.33}  its encoder sees a third of the motion (-1: reversed)
    {"fault": "jump", "id": 3, "degrees": 20}   its encoder reports 20 degrees more from now on
    {"fault": "slow", "id": 3, "share": 0.1}    a tenth of its top speed is left, until 1
    {"fault": "push", "id": 3, "degrees": 30, "ms": 500}  a hand turns its shaft; under torque it resists
    {"fault": "snap", "id": 3}                  its tendon breaks; with "on": false it is tied again
    {"fault": "tube", "on": false}              a tendon robot is taken out of the tube that holds it straight
    {"fault": "unplug"}                         the port disappears
    {"fault": "replug", "port": "servos2.pty"}  and returns, under another name if one is given

Refused lines are appended with their error to the file's name plus ``.errors``.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import Final, Self

from pydantic import Field, model_validator

from contid.robot_file.base import NonNegative, Strict


@dataclass(slots=True)
class Adapter:
    """Delays of an adapter and of the host's scheduler; 0 is none.

    Attributes:
        late_s: constant lateness of everything.
        latency_s: latency timer: bytes arrive at multiples of it only (an FTDI's factory value is 16 ms).
        chunk: bytes per delivery; each piece arrives when its own last byte was on the wire.
        stalled_until: nothing arrives before this time, then everything at once (a hiccup of the host).
    """

    late_s: float = 0.0
    latency_s: float = 0.0
    chunk: int = 0
    stalled_until: float = 0.0

    def arrivals(
        self, at: float, wire: bytes, byte_s: float, ends: tuple[int, ...] = ()
    ) -> list[tuple[float, bytes]]:
        """Pieces of an answer and their arrival times.

        Args:
            at: time of its last byte on the wire.
            wire: the answer.
            byte_s: time of one byte on the wire.
            ends: ends of the parts that arrive by themselves; none for the whole answer at once.
        """
        whole = len(wire)
        if self.chunk:
            ends = (*range(self.chunk, whole, self.chunk), whole)
        ends = ends or (whole,)
        starts = (0, *ends)
        return [
            (self._arrival(at - (whole - end) * byte_s), wire[start:end])
            for start, end in zip(starts, ends, strict=False)
        ]

    def _arrival(self, at: float) -> float:
        at += self.late_s
        if self.latency_s:
            at = math.ceil(at / self.latency_s) * self.latency_s
        return max(at, self.stalled_until)


_KEYS: Final[dict[str, tuple[str, ...]]] = {
    "drop": ("id", "count"),
    "delay": ("id", "ms"),
    "corrupt": ("id", "count"),
    "duplicate": ("id", "count"),
    "misread": ("id", "count"),
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
    "share": ("id", "share"),
    "jump": ("id", "degrees"),
    "slow": ("id", "share"),
    "push": ("id", "degrees", "ms"),
    "snap": ("id", "on"),
    "tube": ("on",),
    "unplug": (),
    "replug": ("port",),
}
#: Kinds that act on one servo; a brown-out without an id acts on all.
_NEED_ID: Final = {kind for kind, keys in _KEYS.items() if "id" in keys} - {"brownout"}


class InjectedFault(Strict):
    """One fault switch; a kind ignores fields it does not use."""

    kind: str = Field(alias="fault")
    device: int | None = Field(default=None, alias="id")
    count: int = Field(default=1, ge=0)
    ms: NonNegative = 0.0
    hz: NonNegative = 0.0
    bits: int = Field(default=0x04, ge=0, le=0xFF)
    on: bool = True
    degrees: float = 0.0
    share: float = 1.0
    port: str | None = None

    @model_validator(mode="after")
    def _keys_of_the_kind(self) -> Self:
        if self.kind not in _KEYS:
            raise ValueError(f"no fault {self.kind!r}; faults: {', '.join(_KEYS)}")
        given = self.model_dump(by_alias=True, exclude_defaults=True).keys() - {"fault"}
        if unknown := given - set(_KEYS[self.kind]):
            raise ValueError(
                f"fault {self.kind!r} has no {', '.join(sorted(unknown))}; it has {_KEYS[self.kind]}"
            )
        if self.kind in _NEED_ID and self.device is None:
            raise ValueError(f"fault {self.kind!r} needs an id")
        return self


@dataclass(slots=True)
class FaultSwitches:
    """Faults of the answers of a bus that are on.

    Attributes:
        echo: the adapter returns what the host sends.
        second_host_hz: rate at which a second host reads positions; 0 for none.
        adapter: late, batched or chunked delivery.
        silent: ids that neither receive nor answer.
        delay_s: additional delay of answers, by id.
        left: number of the next answers that are dropped, corrupted or duplicated, or instructions that are
            misread, by kind and id.
    """

    echo: bool = False
    second_host_hz: float = 0.0
    adapter: Adapter = field(default_factory=Adapter)
    silent: set[int] = field(default_factory=set)
    delay_s: dict[int, float] = field(default_factory=dict)
    left: dict[tuple[str, int], int] = field(default_factory=dict)

    def set(self, fault: InjectedFault) -> bool:
        """Set a fault of the answers; False for faults of servos or of the port."""
        device = fault.device if fault.device is not None else -1
        match fault.kind:
            case "echo":
                self.echo = fault.on
            case "silent":
                (self.silent.add if fault.on else self.silent.discard)(device)
            case "delay":
                self.delay_s[device] = fault.ms / 1e3
            case "drop" | "corrupt" | "duplicate" | "misread":
                self.left[fault.kind, device] = fault.count
            case "host":
                self.second_host_hz = fault.hz
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
        """Whether the next answer of a servo, or instruction to it, has this fault; decrements its count."""
        if not self.left.get((kind, device)):
            return False
        self.left[kind, device] -= 1
        return True
