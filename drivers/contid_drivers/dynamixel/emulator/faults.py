"""Fault switches of an emulated bus, by call and by a control file.

Each switch is a `InjectedFault`; as JSON it is one line of the control file, which is read from its end on::

    {"fault": "drop", "id": 3, "count": 2}      the next two answers of servo 3 never arrive
    {"fault": "delay", "id": 3, "ms": 4}        every answer of servo 3 is 4 ms late, until ms is 0
    {"fault": "corrupt", "id": 3, "count": 1}   a flipped bit in its next answer
    {"fault": "duplicate", "id": 3}             its next answer arrives twice
    {"fault": "echo", "on": true}               the adapter returns what the host sends
    {"fault": "silent", "id": 3, "on": true}    deaf and mute until "on": false
    {"fault": "alert", "id": 3, "bits": 4}      hardware error status; 4 is overheated
    {"fault": "overload", "id": 3}              the same with bits 32, which drops the torque
    {"fault": "brownout"}                       every servo resets itself; with an id, only that one
    {"fault": "trip", "id": 3}                  Bus Watchdog trip
    {"fault": "unplug"}                         the port disappears
    {"fault": "replug", "port": "servos2.pty"}  and comes back, under another name if one is given
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from contid.errors import ContidError

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
    "unplug": (),
    "replug": ("port",),
}
_NEED_ID: Final = {"drop", "delay", "corrupt", "duplicate", "silent", "alert", "overload", "trip"}


class FaultSyntaxError(ContidError):
    """A fault switch that is none."""


@dataclass(frozen=True, slots=True)
class InjectedFault:
    """One fault switch; fields a kind does not have are ignored."""

    kind: str
    device: int | None = None
    count: int = 1
    ms: float = 0.0
    bits: int = 0x04
    on: bool = True
    port: str | None = None

    def __post_init__(self) -> None:
        """Refuse kinds there are not."""
        if self.kind not in _KEYS:
            raise FaultSyntaxError(f"no fault {self.kind!r}; there are {', '.join(_KEYS)}")
        if self.kind in _NEED_ID and self.device is None:
            raise FaultSyntaxError(f"fault {self.kind!r} needs an id")

    @classmethod
    def parse(cls, line: str) -> InjectedFault:
        """From one line of a control file.

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
    """What is wrong with the answers of a bus right now."""

    echo: bool = False
    silent: set[int] = field(default_factory=set)
    delay_s: dict[int, float] = field(default_factory=dict)
    drop: dict[int, int] = field(default_factory=dict)
    corrupt: dict[int, int] = field(default_factory=dict)
    duplicate: dict[int, int] = field(default_factory=dict)

    def set(self, fault: InjectedFault) -> bool:
        """Take over a switch that concerns answers; False for those that concern servos or the port."""
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
        else:
            return False
        return True

    def spent(self, kind: str, device: int) -> bool:
        """True when the next answer of a servo has this fault; counts it off."""
        counts: dict[int, int] = getattr(self, kind)
        if not counts.get(device):
            return False
        counts[device] -= 1
        return True


class ControlFile:
    """Follows a file to which fault switches are appended, one JSON object per line."""

    def __init__(self, path: Path) -> None:
        self.path = path
        path.touch()
        self._at = path.stat().st_size

    def news(self) -> list[str]:
        """Whole lines added since the last call."""
        if self.path.stat().st_size <= self._at:
            return []
        with self.path.open("rb") as file:
            file.seek(self._at)
            data = file.read()
        whole = data[: data.rfind(b"\n") + 1]
        self._at += len(whole)
        return [line for line in whole.decode(errors="replace").splitlines() if line.strip()]
