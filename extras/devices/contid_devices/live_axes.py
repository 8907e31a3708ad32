"""The axes of buses as their devices report them: ``contid servo ROBOT``."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

from rich.console import Console
from rich.live import Live
from rich.table import Table

from contid.hal import DeviceKind, Sample
from contid.units import BAR
from contid_devices.homing.zero_here import reading

if TYPE_CHECKING:
    from contid.control.engine.wiring import WiredBus

PERIOD_S: Final = 0.2
#: Exchanges before the first table: slow values come in turn.
_FIRST: Final = 30


def show(buses: Sequence[WiredBus], once: bool) -> None:
    """Print a table, or show it until Ctrl-C.

    Raises:
        DeviceNotFoundError: a device is missing, or a daemon has the port: `contid status` shows its axes.
    """
    kinds = {axis.name: bus.driver.kind(axis.options) for bus in buses for axis in bus.axes}
    console = Console()
    with reading(buses) as read:
        for _ in range(_FIRST):
            samples = read()
        if once or not console.is_terminal:
            console.print(table(samples, kinds))
            return
        with Live(table(samples, kinds), console=console, auto_refresh=False) as live:
            while True:
                time.sleep(PERIOD_S)
                live.update(table(read(), kinds), refresh=True)


def table(samples: Mapping[str, Sample], kinds: Mapping[str, DeviceKind]) -> Table:
    """One row per axis."""
    shown = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    shown.add_column("axis")
    for heading in ("position", "effort", "supply", "temperature"):
        shown.add_column(heading, justify="right")
    shown.add_column("")
    for axis, sample in samples.items():
        regulator = kinds[axis] is DeviceKind.REGULATOR
        place = _text(
            sample.value, 1 / BAR if regulator else math.degrees(1.0), ".2f bar" if regulator else ".2f deg"
        )
        effort = _text(sample.effort, *((100.0, ".0f % duty") if regulator else (1e3, ".0f mA")))
        volts, degrees = _text(sample.voltage_v, 1.0, ".1f V"), _text(sample.temperature_c, 1.0, ".0f C")
        shown.add_row(axis, place, effort, volts, degrees, sample.fault or ("" if sample.valid else "silent"))
    return shown


def _text(value: float | None, scale: float, how: str) -> str:
    digits, unit = how.split(" ", 1)
    return "-" if value is None else f"{value * scale:{digits}} {unit}"
