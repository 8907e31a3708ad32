"""The section ``bringup:``: what was proven about each axis, and whether its wiring was changed since."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Final, Literal, NamedTuple

from pydantic import Field

from contid.hal import Finding, load_driver
from contid.hal.pulses import ProvenDevice, Proves
from contid.robot_file.base import NonNegative, Positive, Strict

if TYPE_CHECKING:
    from contid.robot_file.document import BusWiring
    from contid.robot_file.load import LoadedFile

#: Share of its velocities that a robot keeps while an axis is not as it was proven.
UNPROVEN_SHARE: Final = 0.2
_VELOCITIES: Final = ("velocity_mm_s", "velocity_bar_s", "velocity_deg_s")
#: What to do about an axis that is not as it was proven.
_REMEDY = "contid bringup FILE {axis}"


class AxisBringup(Strict):
    """What ``contid bringup`` found about one axis; it writes this section.

    Attributes:
        date: when, in local time.
        verdict: ``ok``, or the name of the fault.
        wiring: digest of the keys that depend on cables and parts, as they were then.
        device: unchangeable id of the board or servo.
        firmware: its firmware.
        friction_percent: duty that just keeps the motor turning.
        no_load_deg_s: speed of its shaft at full duty, without friction.
        time_constant_ms: response of its speed.
        now: in recordings: what answered instead when the run began. Not for your own files.
    """

    date: str
    verdict: str
    wiring: Annotated[str, Field(pattern="^[0-9a-f]{12}$")]
    device: str
    firmware: str
    friction_percent: NonNegative | None = None
    no_load_deg_s: Positive | None = None
    time_constant_ms: NonNegative | None = None
    now: str = ""


def wiring_digest(bus: BusWiring, axis: str) -> str:
    """Digest of the keys of an axis that depend on its cables and parts."""
    driver = load_driver(bus.driver)
    options = dict(bus.axes)[axis]
    keys = (
        dict(driver.wiring(bus.options, options))
        if isinstance(driver, Proves)
        else options.model_dump(mode="json")
    )
    text = json.dumps({"driver": bus.driver, "bus": bus.name, **keys}, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def changed_axes(loaded: LoadedFile) -> dict[str, str]:
    """What is not as it was proven, by axis; axes without a change, or without a bring-up, are left out."""
    buses = {axis: bus for bus in loaded.buses.values() for axis, _ in bus.axes}
    changed = {}
    for axis, found in loaded.file.bringup.items():
        if axis not in buses:
            continue
        if found.verdict != "ok":
            changed[axis] = f"{found.verdict} at its last bring-up, {found.date}"
        elif found.wiring != wiring_digest(buses[axis], axis):
            changed[axis] = f"its wiring in this file was changed since its bring-up, {found.date}"
        elif found.now:
            changed[axis] = found.now
    return changed


def slowed(loaded: LoadedFile) -> LoadedFile:
    """The same file, whose robots with a changed axis have `UNPROVEN_SHARE` of their velocities."""
    names = {axis.partition(".")[0] for axis in changed_axes(loaded)}
    if not names:
        return loaded
    robots = dict(loaded.file.robots)
    for name in names & robots.keys():
        rates = robots[name].rates
        slow = {
            key: value * UNPROVEN_SHARE for key in _VELOCITIES if (value := getattr(rates, key)) is not None
        }
        robots[name] = robots[name].model_copy(update={"rates": rates.model_copy(update=slow)})
    return replace(loaded, file=loaded.file.model_copy(update={"robots": robots}))


class AxisProof(NamedTuple):
    """How far the bring-up of one axis is.

    Attributes:
        state: ``proven``; ``pending``, never brought up; ``changed`` since, or ``failed``, in both of which
            its robot is slowed; ``none`` where its driver has no bring-up.
        message: the same for a person.
        bus, driver: its devices.
        found: the last bring-up; None without one.
    """

    state: Literal["proven", "pending", "changed", "failed", "none"]
    message: str
    bus: str
    driver: str
    found: AxisBringup | None

    def as_fields(self) -> dict[str, str]:
        """As clients get it."""
        found = {} if self.found is None else self.found.model_dump(include={"date", "device", "firmware"})
        return {"state": self.state, "message": self.message, "bus": self.bus, "driver": self.driver, **found}


def proofs(loaded: LoadedFile) -> dict[str, AxisProof]:
    """How far the bring-up of every axis is, by ``ROBOT.AXIS``; opens no device."""
    proven, changed = loaded.file.bringup, changed_axes(loaded)
    out = {}
    for bus in loaded.buses.values():
        brings_up = isinstance(load_driver(bus.driver), Proves)
        for axis, _ in bus.axes:
            found = proven.get(axis)
            if found is None:
                message = "never brought up" if brings_up else f"{bus.driver} devices have no bring-up"
                out[axis] = AxisProof("pending" if brings_up else "none", message, bus.name, bus.driver, None)
            elif axis in changed:
                message = f"{changed[axis]}; {slow_notice(axis)}"
                state: Literal["changed", "failed"] = "changed" if found.verdict == "ok" else "failed"
                out[axis] = AxisProof(state, message, bus.name, bus.driver, found)
            else:
                out[axis] = AxisProof("proven", f"proven {found.date}", bus.name, bus.driver, found)
    return out


def bringup_findings(loaded: LoadedFile) -> Iterator[Finding]:
    """One finding per axis of a file with ``bringup:``; opens no device."""
    if not loaded.file.bringup:
        return
    found = proofs(loaded)
    for axis, proof in found.items():
        if proof.state == "proven":
            yield Finding(f"bringup {axis}", True, proof.message)
        elif proof.state != "none":
            ok = proof.state != "failed"
            yield Finding(f"bringup {axis}", ok, proof.message, _REMEDY.format(axis=axis), warning=ok)
    for axis in loaded.file.bringup.keys() - found.keys():
        yield Finding(f"bringup {axis}", True, "no such axis any more", "remove it", warning=True)


def slow_notice(axis: str) -> str:
    """What follows for the robot of a changed axis."""
    return f"{axis.partition('.')[0]} moves at {UNPROVEN_SHARE:.0%} of its velocities until it is brought up"


def device_change(found: AxisBringup, device: ProvenDevice) -> str:
    """What is another than at the bring-up of an axis: its device or firmware; "" for nothing."""
    for what, before, now in (
        ("device", found.device, device.identity),
        ("firmware", found.firmware, device.firmware),
    ):
        if before != now:
            return f"its {what} is {now}; at its bring-up, {found.date}, it was {before}"
    return ""


def device_finding(axis: str, change: str) -> Finding:
    """The finding about an axis with another device or firmware."""
    return Finding(
        f"bringup {axis}", True, f"{change}; {slow_notice(axis)}", _REMEDY.format(axis=axis), warning=True
    )
