"""What load sensing and compensation add to a tick: ``python benchmarks/load_tick.py [TICKS]``.

stiffflop1 and stiffflop2 at 500 Hz with simulated devices and a tracker of 50 Hz, on a moving tip target, a
payload of 3 g after 2 s. Engines with and without ``sense`` take turns, tick by tick, in one process. Times
are processor times of the thread, because the machine is shared; the clock itself takes a microsecond. The
added time is that of the calls that sensing and compensation make in a tick.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from contid.control.engine.messages import Rows
from contid.control.engine.virtual import VirtualProcess
from contid.robot_file.cosserat import Cosserat, SimulatedArm
from contid.robot_file.load import LoadedFile, with_mock
from contid.robot_file.pneumatic.sense import LoadSensing, ModelErrors, Sense
from contid.robot_file.shipped import load_named
from contid.targets import Target

RATE_HZ: Final = 500.0
#: Ticks before the first that counts: the arm approaches, caches fill.
WARM_UP: Final = 750
BAR_US: Final = 100.0


class Silent:
    """A sink of nothing."""

    def write(self, values: list[float]) -> None:
        """See `contid.control.engine.cycle.Sink`."""

    def event(self, event: object) -> None:
        """See `contid.control.engine.cycle.Sink`."""


def sensing(robot: Cosserat) -> Sense:
    """A calibration that found no error, as uncertain as a real one of 30 poses."""
    axes, sections = len(robot.axis_names), len(robot.geometry.sections)
    sigmas = [2e-3] * axes + [2e-3] * axes + [1e-3] * axes + [5e-3] * (2 * sections)
    errors = ModelErrors(
        offset_bar=(0.0,) * axes,
        gain=(0.0,) * axes,
        loop_bar=(-0.002,) * axes,
        modulus=(0.0,) * sections,
        moment=(0.0,) * sections,
        axis_sigma_bar=1e-3,
        tip_sigma_mm=0.05,
        covariance_factor=tuple((0.0,) * k + (sigma,) for k, sigma in enumerate(sigmas)),
        corrects="robot",
    )
    return Sense(load=LoadSensing(calibration=errors))


def arm_file(name: str, sensed: bool) -> tuple[LoadedFile, Cosserat]:
    """The shipped file with a payload and a tracker, with or without sensing."""
    loaded = with_mock(load_named(name))
    (robot,) = loaded.file.robots.values()
    assert isinstance(robot, Cosserat)
    changes: dict[str, Any] = {"sim": SimulatedArm(payload_g=3.0, payload_at_s=2.0)}
    if sensed:
        changes |= {"sense": sensing(robot), "load": "estimated"}
    loaded.file.robots["arm"] = robot.model_copy(update=changes)
    return loaded, robot


class Timed:
    """A call whose processor time is added up."""

    def __init__(self, call: Callable[..., Any]) -> None:
        self._call = call
        self.spent_ns = 0

    def __call__(self, *arguments: Any) -> Any:
        """The call."""
        begin = time.thread_time_ns()
        result = self._call(*arguments)
        self.spent_ns += time.thread_time_ns() - begin
        return result


def measure(name: str, ticks: int) -> None:
    """Turn both engines alternately and print their times."""
    files = {False: arm_file(name, False), True: arm_file(name, True)}
    processes = {sensed: VirtualProcess(loaded, RATE_HZ, Silent()) for sensed, (loaded, _) in files.items()}
    model = processes[False].engine.configs[0].model
    middle = tuple(0.4 * top for top in model.upper)
    x, y, z = model.forward(middle).tip_m
    loads: Any = processes[True].engine._loads
    loads.tick, loads.loaded = Timed(loads.tick), Timed(loads.loaded)
    whole: dict[bool, list[float]] = {False: [], True: []}
    added: list[float] = []
    for process in processes.values():
        process.engine.arm()
    for k in range(ticks + WARM_UP):
        angle = 2.0 * math.pi * k / RATE_HZ / 4.0
        target = Target(tip_m=(x + 4e-3 * math.cos(angle), y + 4e-3 * math.sin(angle), z))
        for sensed in (False, True) if k % 2 else (True, False):
            process = processes[sensed]
            process.begin()
            if process.engine.armed:
                process.engine.obey(Rows({"arm": target}), process.tick)
            loads.tick.spent_ns = loads.loaded.spent_ns = 0
            begin = time.thread_time_ns()
            process.turn()
            if k >= WARM_UP:
                whole[sensed].append((time.thread_time_ns() - begin) / 1e3)
                if sensed:
                    added.append((loads.tick.spent_ns + loads.loaded.spent_ns) / 1e3)
    for process in processes.values():
        process.close()
    print(f"{name}, {ticks} ticks of each")
    _row("tick without", whole[False])
    _row("tick with sensing and compensation", whole[True])
    _row("added", added)
    p99 = float(np.percentile(added, 99.0))
    print(
        f"  p99 of what is added: {p99:.0f} us, bar {BAR_US:.0f} us: {'met' if p99 <= BAR_US else 'NOT MET'}"
    )


def _row(name: str, values_us: list[float]) -> None:
    p50, p99, p999 = np.percentile(values_us, [50.0, 99.0, 99.9])
    print(f"  {name:36s} p50 {p50:6.0f}  p99 {p99:6.0f}  p99.9 {p999:6.0f} us")


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    for arm in ("stiffflop1", "stiffflop2"):
        measure(arm, count)
