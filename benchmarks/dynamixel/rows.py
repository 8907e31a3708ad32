"""One row of the table: the cycles of a bus, and what the wire alone would allow."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass
class Row:
    """One line of the table."""

    what: str
    servos: int
    baud: int
    bytes_read: int
    wire_limit_per_s: float
    invalid: int = 0
    wall_s: float = 0.0
    cpu_s: float = 0.0
    times_s: list[float] = field(default_factory=list, repr=False)

    @property
    def rate_per_s(self) -> float:
        """Cycles per second of the whole time."""
        return len(self.times_s) / self.wall_s

    @property
    def median_rate_per_s(self) -> float:
        """Cycles per second if all were as long as the median one."""
        return 1.0 / statistics.median(self.times_s)

    @property
    def cpu_percent(self) -> float:
        """CPU of this process over the wall time."""
        return 100.0 * self.cpu_s / self.wall_s

    def part(self, rate_per_s: float) -> float:
        """Per cent of the wire limit."""
        return 100.0 * rate_per_s / self.wire_limit_per_s

    def __str__(self) -> str:
        p99_ms = 1e3 * sorted(self.times_s)[int(0.99 * len(self.times_s))]
        return (
            f"{self.what:30s} {self.servos:2d} servos {self.baud / 1e6:3g}M {self.bytes_read:2d} B"
            f" {self.rate_per_s:5.0f}/s, {self.median_rate_per_s:5.0f}/s by the median,"
            f" of {self.wire_limit_per_s:5.0f} ({self.part(self.rate_per_s):3.0f}, "
            f"{self.part(self.median_rate_per_s):3.0f} %)  cpu {self.cpu_percent:5.1f} %"
            f"  p50 {1e3 / self.median_rate_per_s:6.3f}  p99 {p99_ms:6.3f} ms  invalid {self.invalid}"
        )

    @property
    def invalid_permille(self) -> float:
        """Invalid samples per thousand."""
        return 1e3 * self.invalid / (self.servos * len(self.times_s))

    def summary(self) -> dict[str, object]:
        """Its figures, for --json."""
        names = ("what", "servos", "baud", "bytes_read", "wire_limit_per_s", "invalid")
        figures = {name: getattr(self, name) for name in names}
        rates = {name: getattr(self, name) for name in ("rate_per_s", "median_rate_per_s", "cpu_percent")}
        return figures | rates


def wire_limit(count: int, size: int, baud: int, fast: bool) -> float:
    """Cycles per second when nothing but the bytes takes time."""
    answer = 8 + count * (size + 4) if fast else count * (size + 11)
    return baud / 10.0 / ((14 + 5 * count) + (14 + count) + answer)


def measure(row: Row, seconds: float, cycle: Callable[[], int]) -> None:
    for _ in range(30):
        cycle()
    cpu, start = time.process_time(), time.perf_counter()
    before = start
    while before - start < seconds:
        row.invalid += cycle()
        after = time.perf_counter()
        row.times_s.append(after - before)
        before = after
    row.wall_s += before - start
    row.cpu_s += time.process_time() - cpu
