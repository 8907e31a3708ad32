"""Draw docs/images/processes.svg of docs/concepts.md: ``python -m docs.drawings.processes``."""

from __future__ import annotations

from docs.drawings.svg import Svg, write_drawings

TARGETS, SAMPLES, RECORDS = "#1b4965", "#ca6702", "#6c757d"
STYLE = {
    "process": 'fill="#f1f5f8" stroke="black"',
    "part": 'fill="white" stroke="#1b4965"',
    "device": 'fill="#fdf3e7" stroke="black"',
}


class Figure(Svg):
    """Boxes and arrows; coordinates in pixels."""

    def __init__(self, title: str, width: int, height: int) -> None:
        super().__init__(title, width, height, {"t": TARGETS, "s": SAMPLES, "r": RECORDS})

    def box(self, kind: str, x: int, y: int, width: int, height: int, *lines: str) -> None:
        """A box with lines of text at its top; the first is bold."""
        self.add(f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="5" {STYLE[kind]}/>')
        for i, text in enumerate(lines):
            self.note((x + 8, y + 17 + 15 * i), text, bold=i == 0)

    def arrow(self, colour: str, *points: tuple[int, int]) -> None:
        """A line through points with its head at the last."""
        name = {TARGETS: "t", SAMPLES: "s", RECORDS: "r"}[colour]
        self.polyline(points, colour, 2, ends=(name,))


def figure() -> Figure:
    """Processes as grey boxes, parts of the control process as white ones, and what passes between them."""
    f = Figure("Processes of contid and the way of targets and samples", 960, 500)
    f.box("process", 16, 20, 170, 62, "trajectory", "CSV or NDJSON, on stdin", "or --trajectory FILE")
    f.box(
        "process", 16, 106, 170, 92, "clients", "contid move, stop, ...", "Client in a script", "contid panel"
    )
    f.note((24, 191), "one of them has the lease")
    f.box("process", 16, 222, 170, 62, "contid fleet serve", "bridge between machines,", "a client as well")
    f.box(
        "process",
        270,
        20,
        200,
        264,
        "daemon (contid run)",
        "asyncio; may be late",
        "",
        "reads the robot file",
        "checks trajectories",
        "serves the Unix socket:",
        "  lease, orders, telemetry",
        "supervises, restarts nothing",
        "makes the closing report",
    )
    f.box("process", 560, 20, 384, 264, "control process", "real time; one tick every 1 / rate_hz")
    for i, (name, what) in enumerate(
        (
            ("sampler", "target at this instant"),
            ("model", "inverse kinematics"),
            ("limiter", "position, velocity, acceleration, jerk"),
            ("transmission", "lengths to angles or pressures"),
            ("buses", "one driver and one thread each"),
        )
    ):
        y = 62 + 44 * i
        f.box("part", 590, y, 324, 30)
        f.note((600, y + 20), name, bold=True)
        f.note((690, y + 20), what)
        if i:
            f.arrow(TARGETS, (640, y - 14), (640, y - 1))
            f.arrow(SAMPLES, (880, y - 1), (880, y - 13))
    f.arrow(TARGETS, (186, 50), (269, 50))
    f.arrow(TARGETS, (186, 145), (269, 145))
    f.arrow(SAMPLES, (270, 165), (187, 165))
    f.note((192, 137), "socket")
    f.arrow(TARGETS, (186, 253), (269, 253))
    f.arrow(TARGETS, (470, 77), (589, 77))
    f.note((478, 69), "pipe: targets,")
    f.note((478, 93), "orders")
    f.box("device", 560, 340, 384, 62, "devices", "servos, motors, regulators: real, emulated or simulated")
    f.note((568, 387), "each with its own watchdog, refreshed by completed ticks only")
    f.arrow(TARGETS, (640, 268), (640, 339))
    f.note((648, 318), "commands", colour=TARGETS)
    f.arrow(SAMPLES, (880, 340), (880, 269))
    f.note((822, 318), "samples", colour=SAMPLES)
    f.box(
        "part",
        270,
        340,
        200,
        62,
        "ring in /dev/shm",
        "one record per tick, and",
        "events; readers never block it",
    )
    f.arrow(RECORDS, (560, 270), (515, 270), (515, 360), (471, 360))
    f.note((478, 318), "record", colour=RECORDS)
    f.arrow(SAMPLES, (370, 340), (370, 285))
    f.note((378, 318), "telemetry")
    f.box("process", 16, 340, 170, 62, "recorder", "writes FILE.mcap, every", "tick before the next")
    f.arrow(RECORDS, (270, 362), (187, 362))
    f.box("process", 16, 426, 170, 48, "viewer", "contid run --view")
    f.arrow(RECORDS, (300, 402), (300, 450), (187, 450))
    for i, (colour, text) in enumerate(
        (
            (TARGETS, "targets and commands"),
            (SAMPLES, "samples and telemetry"),
            (RECORDS, "records and events"),
        )
    ):
        x = 360 + 190 * i
        f.arrow(colour, (x, 455), (x + 30, 455))
        f.note((x + 38, 459), text)
    return f


DRAWINGS = {"processes.svg": figure}


if __name__ == "__main__":
    write_drawings(DRAWINGS)
