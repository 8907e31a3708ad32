"""The section ``bringup:``: what was proven about each axis, and whether its wiring was changed since."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from contid.hal import Finding, load_driver
from contid.hal.pulses import ProvenDevice, Proves
from contid.robot_file.base import NonNegative, Positive, Strict

if TYPE_CHECKING:
    from contid.robot_file.document import BusWiring
    from contid.robot_file.load import LoadedFile

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
    """

    date: str
    verdict: str
    wiring: Annotated[str, Field(pattern="^[0-9a-f]{12}$")]
    device: str
    firmware: str
    friction_percent: NonNegative | None = None
    no_load_deg_s: Positive | None = None
    time_constant_ms: NonNegative | None = None


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


def bringup_findings(loaded: LoadedFile) -> Iterator[Finding]:
    """One finding per axis of a file with ``bringup:``; opens no device."""
    proven = loaded.file.bringup
    if not proven:
        return
    buses = {axis: bus for bus in loaded.buses.values() for axis, _ in bus.axes}
    for axis, bus in buses.items():
        found = proven.get(axis)
        remedy = _REMEDY.format(axis=axis)
        if found is None:
            if isinstance(load_driver(bus.driver), Proves):
                yield Finding(f"bringup {axis}", True, "never brought up", remedy, warning=True)
        elif found.verdict != "ok":
            message = f"{found.verdict} at its last bring-up, {found.date}"
            yield Finding(f"bringup {axis}", False, message, remedy)
        elif found.wiring != wiring_digest(bus, axis):
            message = f"its wiring in this file was changed since its bring-up, {found.date}"
            yield Finding(f"bringup {axis}", True, message, remedy, warning=True)
        else:
            yield Finding(f"bringup {axis}", True, f"proven {found.date}")
    for axis in proven.keys() - buses.keys():
        yield Finding(f"bringup {axis}", True, "no such axis any more", "remove it", warning=True)


def device_finding(axis: str, found: AxisBringup, device: ProvenDevice) -> Finding | None:
    """A finding when an axis has another device or firmware than at its bring-up."""
    remedy = _REMEDY.format(axis=axis)
    for what, before, now in (
        ("device", found.device, device.identity),
        ("firmware", found.firmware, device.firmware),
    ):
        if before != now:
            message = f"its {what} is {now}; at its bring-up, {found.date}, it was {before}"
            return Finding(f"bringup {axis}", True, message, remedy, warning=True)
    return None
