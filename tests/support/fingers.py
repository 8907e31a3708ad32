"""Robot files of any number of fingers on simulated buses, and a circle for them to follow."""

from __future__ import annotations

import io
import math
from typing import Any

from contid.control.engine.events import RunEvent
from contid.control.engine.events.json_form import to_json
from contid.control.engine.virtual import run_virtual
from contid.robot_file.load import LoadedFile, parse_robot_file
from contid.trajectory.read import read_trajectory
from contid.trajectory.timed import Trajectory

FINGER = """\
  {name}:
    model: rack_finger
    base: {{x_mm: {x}, mirror_x: {mirror}}}
    geometry:
      rack_spacing_mm: 13
      tip_length_mm: 22
      link: {{length_mm: 6, width_mm: 13, gap_mm: 5}}
    limits: {{length_mm: [0, 100]}}
    correction: {{a_per_mm: 0.0013, b: -0.2774, arc_length_mm: [0, 213.4]}}
    rates: {{velocity_mm_s: 100, acceleration_mm_s2: 1000, jerk_mm_s3: 20000}}
    rest_mm: [60, 60]
    stop: {{on_end: {on_end}, on_interrupt: {on_interrupt}, on_fault: {on_fault}, on_host_loss: relax}}
    axes:
      left: {{bus: {bus}, device: servo, velocity_deg_s: 1200, mm_per_rev: 37.7}}
      right: {{bus: {bus}, device: servo, velocity_deg_s: 1200, mm_per_rev: 37.7}}
"""


def fingers(
    count: int,
    *,
    buses: int = 1,
    options: str = "",
    on_end: str = "hold",
    on_interrupt: str = "hold",
    on_fault: str = "hold",
    tolerance: int = 3,
    rate_hz: int = 200,
) -> str:
    """A robot file; ``options`` are further lines of the first bus."""
    lines = ["contid: 1", "name: fingers", f"rate_hz: {rate_hz}", "buses:"]
    for bus in range(buses):
        lines += [f"  bus{bus}:", "    driver: sim", f"    tolerance_ticks: {tolerance}"]
        lines += [f"    {line}" for line in options.splitlines()] if bus == 0 else []
    lines.append("robots:")
    text = "\n".join(lines) + "\n"
    for index in range(count):
        text += FINGER.format(
            name=f"f{index}",
            x=100 * (index % 2),
            mirror=str(bool(index % 2)).lower(),
            bus=f"bus{index % buses}",
            on_end=on_end,
            on_interrupt=on_interrupt,
            on_fault=on_fault,
        )
    return text


def load(count: int, **keys: object) -> LoadedFile:
    return parse_robot_file(fingers(count, **keys), "fingers.yaml")  # type: ignore[arg-type]


def circle_csv(count: int, period_s: float = 1.0, rows: int = 50, radius_mm: float = 5.0) -> str:
    """A circle that every finger can follow, at constant speed from the first row to the last."""
    lines = ["t_s," + ",".join(f"f{i}.x_mm,f{i}.y_mm" for i in range(count))]
    for row in range(rows + 1):
        angle = 2.0 * math.pi * row / rows
        x, y = 50.0 + radius_mm * math.cos(angle), 75.0 + radius_mm * math.sin(angle)
        lines.append(f"{period_s * row / rows!r}," + ",".join(f"{x!r},{y!r}" for _ in range(count)))
    return "\n".join(lines) + "\n"


def circle(loaded: LoadedFile, **keys: object) -> Trajectory:
    robots = loaded.driven
    text = circle_csv(len(robots), **keys)  # type: ignore[arg-type]
    return read_trajectory(io.StringIO(text), "circle.csv", robots)


class Collector:
    """A sink that keeps everything."""

    def __init__(self, loaded: LoadedFile | None = None) -> None:
        from contid.control.engine.wiring import record_layout

        self.events: list[dict[str, Any]] = []
        self.layout = None if loaded is None else record_layout(loaded, loaded.file.rate_hz)
        self.records: list[Any] = []

    def write(self, values: list[float]) -> None:
        if self.layout is not None:
            self.records.append(self.layout.decode(tuple(values)))

    def event(self, event: RunEvent) -> None:
        self.events.append(to_json(event))

    def modes(self, robot: str) -> list[str]:
        return [str(e["mode"]) for e in self.events if e["event"] == "state" and e["robot"] == robot]


__all__ = ["Collector", "circle", "circle_csv", "fingers", "load", "run_virtual"]
