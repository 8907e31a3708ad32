"""Cost of a tick for 1 to 256 fingers and 1 to 128 arms, and how many of them hold 200 Hz in real time.

``python -m benchmarks.scale [--plot FILE.svg] [--real-time]``. Every tip follows a path of its own, so
each tick solves every model; all robots are on one simulated bus, whose cost is measured apart. Medians and
99th percentiles of single ticks in processor time. In real time the count is doubled until more than 0.5 % of
the ticks are skipped, then the interval is bisected to a tenth.
"""

from __future__ import annotations

import argparse
import copy
import gc
import io
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml

from contid.control.daemon.budget import ALLOWED
from contid.control.engine.events import RunEvent
from contid.control.engine.virtual import VirtualProcess
from contid.control.engine.wiring import build_robot_configs
from contid.hal import Sample, load_driver
from contid.robot_file.load import LoadedFile, find_robot_file, load_robot_file, parse_robot_file, with_mock
from contid.trajectory.read import read_trajectory
from contid_drivers.sim.bus import SimBus

RATE_HZ: Final = 200.0
COUNTS: Final = {"finger": (1, 2, 4, 8, 16, 32, 64, 128, 256), "trirack2": (1, 2, 4, 8, 16, 32, 64, 128)}
#: Where the search in real time begins.
FIRST: Final = 32
WHAT: Final = {"finger": "fingers (2 axes)", "trirack2": "arms (2 sections, 6 axes)"}
TICKS: Final = 400
#: A rate is held when at most this share of the ticks was skipped.
HELD: Final = 0.005


def many(name: str, count: int) -> LoadedFile:
    """Copies of the one robot of a shipped file, on one simulated bus."""
    shipped = load_robot_file(find_robot_file(name))
    # Keys of the devices, which make way for those of simulated ones.
    drivers = {bus.driver for bus in shipped.buses.values()}
    keys = {key for driver in drivers for key in load_driver(driver).axis_options.model_fields}
    axes = dict(axis for bus in with_mock(shipped).buses.values() for axis in bus.axes)
    ((own, robot),) = yaml.safe_load(shipped.text)["robots"].items()
    robots = {}
    for number in range(count):
        one = copy.deepcopy(robot)
        one.pop("placeholder", None)
        for axis, entry in one["axes"].items():
            options = axes[f"{own}.{axis}"].model_dump(mode="json", exclude_none=True)
            one["axes"][axis] = {
                "bus": "sim",
                **{key: value for key, value in entry.items() if key not in {*keys, "bus"}},
                **options,
            }
        robots[f"r{number}"] = one
    data: dict[str, Any] = {"contid": 1, "name": name, "rate_hz": RATE_HZ}
    data |= {"buses": {"sim": {"driver": "sim"}}, "robots": robots}
    return parse_robot_file(yaml.safe_dump(data, sort_keys=False), f"{name}s.yaml")


def tips(loaded: LoadedFile, seconds: float, rows_hz: float = 20.0) -> str:
    """Every tip on a small closed path around the middle of its range, so that each tick solves the model."""
    configs = build_robot_configs(loaded, RATE_HZ)
    flat = configs[0].kind == "rack_finger"
    header, columns = ["t_s"], []
    rows = max(int(seconds * rows_hz), 20)
    columns.append([seconds * row / (rows - 1) for row in range(rows)])
    for number, config in enumerate(configs):
        header += [f"{config.name}.{axis}_mm" for axis in ("xy" if flat else "xyz")]
        middle = [0.5 * (a.lower + a.upper) for a in config.limits]
        ways = []
        for row in range(rows):
            angle = 2.0 * math.pi * row / rows + number
            turned = [
                value * (1.0 + 0.05 * math.sin(angle + 2.0 * axis)) for axis, value in enumerate(middle)
            ]
            ways.append([1e3 * value for value in config.model.forward(tuple(turned)).tip_m])
        columns += [[way[axis] for way in ways] for axis in range(2 if flat else 3)]
    lines = [",".join(header), *(",".join(map(repr, row)) for row in zip(*columns, strict=True))]
    return "\n".join(lines) + "\n"


class NullSink:
    """A sink that keeps nothing."""

    def write(self, values: list[float]) -> None:
        """Dropped."""

    def event(self, event: RunEvent) -> None:
        """Dropped."""


@dataclass(frozen=True)
class Cost:
    """Of one tick [us]: the engine's, median and 99th percentile, and the simulated devices' median."""

    robots: int
    engine_us: float
    tail_us: float
    devices_us: float


def measure(name: str, count: int) -> Cost:
    loaded = many(name, count)
    trajectory = read_trajectory(io.StringIO(tips(loaded, 60.0)), "tips", loaded.driven)
    process = VirtualProcess(loaded, RATE_HZ, NullSink(), trajectory=trajectory)
    (bus,) = process.buses.values()
    assert isinstance(bus, SimBus)
    spent = [0.0]
    exchange = bus.exchange

    def timed(commands: Mapping[str, float]) -> Mapping[str, Sample]:
        begin = time.thread_time()
        try:
            return exchange(commands)
        finally:
            spent[0] = time.thread_time() - begin

    bus.exchange = timed  # type: ignore[method-assign]  # a stopwatch around it
    process.engine.arm()
    while process.engine.selector.source is None or not (process.engine.selector.source.time_s or 0.0) > 1.0:
        process.begin()
        process.turn()
    gc.collect()
    gc.disable()
    engine, devices = [], []
    for _ in range(TICKS):
        process.begin()
        begin = time.thread_time()
        process.turn()
        total = time.thread_time() - begin
        engine.append((total - spent[0]) * 1e6)
        devices.append(spent[0] * 1e6)
    gc.enable()
    process.close()
    engine.sort()
    devices.sort()
    return Cost(count, engine[TICKS // 2], engine[int(0.99 * TICKS)], devices[TICKS // 2])


#: Exit code of a run that is refused, and its reason where ticks do not fit.
REFUSED: Final = (2, "Hz fit: lower rate_hz")


def holds(name: str, count: int, seconds: float = 5.0) -> dict[str, Any] | None:
    """Report of a run of this many robots in real time; None for one that `contid run` refuses."""
    loaded = many(name, count)
    with tempfile.TemporaryDirectory() as folder:
        robots, trajectory = Path(folder) / "robots.yaml", Path(folder) / "tips.csv"
        robots.write_text(loaded.text)
        trajectory.write_text(tips(loaded, seconds))
        done = subprocess.run(
            [sys.executable, "-m", "contid", "run", str(robots), "--trajectory", str(trajectory), "--json"],
            capture_output=True, text=True,
        )  # fmt: skip
    if done.returncode == REFUSED[0] and REFUSED[1] in done.stderr:
        return None
    if done.returncode:
        raise SystemExit(done.stderr + done.stdout)
    report: dict[str, Any] = json.loads(done.stdout)
    return report


def lost(report: dict[str, Any]) -> float:
    """Share of the ticks that were skipped."""
    return float(report["skipped"] / report["ticks"])


def kept(report: dict[str, Any]) -> bool:
    """True for a run that held its rate."""
    return lost(report) <= HELD and not report["slowest_hz"]


def search(name: str, first: int) -> tuple[int, int]:
    """The maximum count that was held in real time, and the minimum that was not, a tenth apart."""
    low, high, count = 0, 0, first
    while not high or high - low > max(low // 10, 1):
        # The better of two runs, against load by other jobs.
        report = holds(name, count)
        if report is not None and not kept(report):
            report = min(report, holds(name, count) or report, key=lost)
        held = report is not None and kept(report)
        low, high = (count, high) if held else (low, count)
        row = f"refused: above {100.0 * ALLOWED:.0f} % of the period"
        if report is not None:
            tail = ", ".join(f"{key} {report['lateness'][key]:.0f}" for key in ("p99_us", "max_us"))
            shares = f"{report['late'] / report['ticks']:.2%} late, {lost(report):.2%} skipped"
            slowed = f", slowed to {report['slowest_hz']:g} Hz" if report["slowest_hz"] else ""
            word = "holds" if held else "does not hold"
            row = f"{word}: {shares} of {report['ticks']} ticks{slowed}, {tail}"
        print(f"{WHAT[name]:<28}{count:>7}  {row}", flush=True)
        count = (low + high) // 2 if high else 2 * count
    return low, high


def plot(costs: Mapping[str, list[Cost]], path: Path) -> None:
    import matplotlib

    matplotlib.use("svg")
    from matplotlib import pyplot

    matplotlib.rcParams["svg.hashsalt"] = "contid"
    figure, axes = pyplot.subplots(figsize=(6.0, 3.6), layout="constrained")
    for name, rows in costs.items():
        counts = [row.robots for row in rows]
        (line,) = axes.loglog(counts, [row.engine_us / 1e3 for row in rows], "o-", label=WHAT[name])
        axes.loglog(counts, [row.tail_us / 1e3 for row in rows], ":", color=line.get_color())
    axes.axhline(1e3 / RATE_HZ, color="0.4", linewidth=0.8)
    axes.text(1, 1.08e3 / RATE_HZ, f"period at {RATE_HZ:g} Hz", fontsize=8, color="0.3")
    axes.set(xlabel="robots in one file", ylabel="engine per tick [ms]")
    axes.set_xticks(
        ticks := sorted({count for counts in COUNTS.values() for count in counts}),
        labels=list(map(str, ticks)),
    )
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(title="line: median, dots: 99 %", frameon=False, fontsize=8, title_fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None})


def real_time() -> None:
    print(f"\nreal time, {RATE_HZ:g} Hz, simulated devices in the same process:")
    for name in COUNTS:
        low, high = search(name, FIRST)
        print(f"{WHAT[name]:<28}{low:>7}  is the greatest that was held; {high} were not", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scale", description=__doc__)
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--real-time", action="store_true")
    parser.add_argument("--only-real-time", action="store_true")
    asked = parser.parse_args()
    costs: dict[str, list[Cost]] = {}
    if asked.only_real_time:
        real_time()
        return
    print(
        f"{'':<28}{'robots':>7}{'engine us':>11}{'per robot':>11}{'99 % us':>10}{'simulated devices us':>22}"
    )
    for name, counts in COUNTS.items():
        costs[name] = []
        for count in counts:
            cost = measure(name, count)
            costs[name].append(cost)
            each = cost.engine_us / count
            row = f"{cost.engine_us:>11.0f}{each:>11.1f}{cost.tail_us:>10.0f}{cost.devices_us:>22.0f}"
            print(f"{WHAT[name]:<28}{count:>7}{row}", flush=True)
    if asked.plot is not None:
        plot(costs, asked.plot)
    if asked.real_time:
        real_time()


if __name__ == "__main__":
    main()
