"""`contid status` as tables: buses, robots, faults and axes; once, or repeatedly."""

from __future__ import annotations

import json
import time
from typing import Any, Final

import click
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from contid.client import Client, ConnectionLostError, NoDaemonError
from contid.remote.client.described_robot import unit_of
from contid.remote.protocol.wire import Fields

BAR: Final = 24
_TIER_STYLE: Final = {"fresh": "green", "late": "yellow", "stale": "yellow", "old": "red", "lost": "bold red"}
_STATE_STYLE: Final = {"RUN": "green", "APPROACH": "cyan", "HOLD": "blue", "FAULT": "bold red", "OFF": "dim"}
#: Period of the search for a daemon that ended.
RETRY_S: Final = 1.0


def render_status(status: Fields) -> Group:
    """One status as tables: robots with a fault first, because a low terminal cuts the end off."""
    parts: list[Any] = [_head(status), _buses(status)]
    for name, robot in sorted(status["robots"].items(), key=lambda item: item[1].get("fault") is None):
        parts += _robot(name, robot, status["rate_hz"])
    for each in status["warnings"]:
        style = "yellow" if each["level"] == "warning" else "red"
        parts.append(Text(f"{each['at_s']:.0f} s {each['level']}: {each['message']}", style=style))
    return Group(*parts)


def _head(status: Fields) -> Text:
    late, lease = status["lateness_us"], status["lease"]
    text = Text()
    text.append(status["name"], style="bold")
    text.append(f"  {status['rate_hz']:g} Hz  tick {status['tick']}  {status.get('skipped', 0)} skipped")
    if status.get("waited"):
        text.append(f", {status['waited']} waited for arming")
    if status.get("longest_gap_ms"):
        text.append(f", longest gap {status['longest_gap_ms']:.0f} ms")
    text.append(
        f"  late p50 {_shown(late['p50'], '.0f')} us, max {_shown(late['max'], '.0f')} us (last 200 ticks)"
    )
    text.append(f"\n{status['clients']} clients, lease: {lease['holder'] or 'free'}")
    if lease.get("stopped_by"):
        text.append(f" (stopped by {lease['stopped_by']})", style="yellow")
    if status.get("stalled"):
        text.append("\nthe control process stands still: nothing moves or stops the robots", style="bold red")
    if status.get("overload"):
        text.append(f"\n{status['overload']['message']}", style="bold yellow")
    if status.get("waiting"):
        text.append(f"\n{status['waiting']}; nothing is connected yet", style="yellow")
    if status.get("source_s") is not None:
        text.append(f", trajectory at {status['source_s']:.2f} s")
    return text


def _buses(status: Fields) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for heading in ("bus", "driver", "data", "age", "silent"):
        table.add_column(heading)
    for name, bus in status["buses"].items():
        tier = Text(bus["tier"], style=_TIER_STYLE[bus["tier"]])
        age = "never read" if bus["age_ms"] is None else f"{bus['age_ms']:.1f} ms"
        table.add_row(name, bus["driver"], tier, age, ", ".join(bus["silent"]) or "-")
    return table


def _robot(name: str, robot: Fields, rate_hz: float) -> list[Any]:
    state = robot["state"]
    text = Text("\n")
    text.append(name, style="bold")
    text.append("  ")
    text.append(state, style=_STATE_STYLE.get(state, ""))
    if "axes" not in robot:
        return [text]
    text.append("" if robot["enabled"] else "  no torque", style="dim")
    if robot["tip_mm"] is not None:
        text.append("  tip (" + ", ".join(f"{value:.2f}" for value in robot["tip_mm"]) + ") mm")
    if robot["error_mm"] is not None:
        text.append(f"  error {robot['error_mm']:.3f} mm")
    if robot.get("tick_ms") is not None:
        text.append(
            f"  tick {robot['tick_ms']:.2f} ms, {0.1 * robot['tick_ms'] * rate_hz:.0f} %", style="dim"
        )
    if "estimated_load_n" in robot:
        force = ", ".join(f"{1e3 * value:.1f}" for value in robot["estimated_load_n"])
        half = ", ".join(f"{1.96e3 * value:.1f}" for value in robot["estimated_sigma_n"])
        text.append(f"  load ({force}) ± ({half}) mN")
    parts: list[Any] = [text]
    fault = robot["fault"]
    if fault is not None:
        parts.append(Text(f"fault {fault['number']} {fault['name']}: {fault['what']}", style="red"))
        parts += [Text(f"  {key}: {fault[key]}") for key in ("cause", "reaction", "remedy")]
    return [*parts, _axes(robot)]


def _axes(robot: Fields) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("axis")
    table.add_column("")
    for heading in ("measured", "command", "off"):
        table.add_column(heading, justify="right")
    table.add_column("")
    table.add_column("notes")
    for name, axis in robot["axes"].items():
        unit = unit_of(axis)
        measured, low, high = axis[f"measured_{unit}"], axis[f"min_{unit}"], axis[f"max_{unit}"]
        notes = [] if axis["valid"] else ["silent"]
        notes += axis["limits"]
        if axis["temperature_c"] is not None:
            notes.append(f"{axis['temperature_c']:.0f} C")
        if axis["voltage_v"] is not None:
            notes.append(f"{axis['voltage_v']:.1f} V")
        if axis["effort"] is not None:
            notes.append(f"effort {axis['effort']:.3g}")
        if axis.get("tension_n") is not None:
            notes.append(f"{axis['tension_n']:.2f} N")
        table.add_row(
            name,
            bar(measured, low, high),
            _shown(measured, ".3f"),
            _shown(axis[f"command_{unit}"], ".3f"),
            _shown(axis.get(f"difference_{unit}"), "+.3f"),
            unit,
            ", ".join(notes),
        )
    return table


def bar(value: float | None, low: float, high: float) -> str:
    """A bar of the value between its limits; beyond them it is full or empty."""
    if value is None or not high > low:
        return "·" * BAR
    filled = round(min(max((value - low) / (high - low), 0.0), 1.0) * BAR)
    return "█" * filled + "·" * (BAR - filled)


def _shown(value: float | None, how: str) -> str:
    return "-" if value is None else format(value, how)


def watch_status(socket: str | None, rate_hz: float, as_json: bool) -> None:
    """Show the status until Ctrl-C, one below the other where stdout is no terminal.

    A daemon that ended is searched again; with ``as_json`` stderr has the error, once.
    """
    console, missing = Console(), ""
    with Live(console=console, auto_refresh=False, screen=False) as live:

        def show(status: RenderableType) -> None:
            if console.is_terminal:
                live.update(status, refresh=True)
            else:  # a live view would be written at its end only
                console.print(status)

        while True:
            try:
                with Client(socket, name="contid status --watch") as client:
                    while True:
                        status, missing = client.status(), ""
                        if as_json:
                            live.console.file.write(json.dumps(status) + "\n")
                            live.console.file.flush()
                        else:
                            show(render_status(status))
                        time.sleep(1.0 / rate_hz)
            except (NoDaemonError, ConnectionLostError) as error:
                if not as_json:
                    show(Text(str(error), style="yellow"))
                elif str(error) != missing:
                    missing = str(error)
                    click.echo(missing, err=True)
                time.sleep(RETRY_S)
