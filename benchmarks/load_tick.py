"""What load sensing and compensation add to a tick: ``python benchmarks/load_tick.py [TICKS]``.

stiffflop1 and stiffflop2 at 500 Hz with simulated devices and a tracker of 50 Hz, on a moving tip target, a
payload of 3 g after 2 s. Engines with and without ``sense`` take turns, tick by tick, in one process. The
added time is that of the calls that sensing and compensation make in a tick. The machine is shared: times are
processor times of the thread, and of every tick the shortest of several runs counts, which do the same in it.
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
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import LoadedFile, load_named, with_mock
from contid.robot_file.pneumatic.sense import LoadSensing, ModelErrors, Sense
from contid.robot_file.pneumatic.simulated import SimulatedArm
from contid.targets import Target
from contid_fit.sense.live.stage import LoadSensingStage

RATE_HZ: Final = 500.0
#: Ticks before the first that counts: the arm approaches, caches fill.
WARM_UP: Final = 750
TIMES: Final = 3
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


def arm_file(name: str, sensed: bool) -> LoadedFile:
    """The shipped file with a payload and a tracker, with or without sensing."""
    loaded = with_mock(load_named(name))
    (robot,) = loaded.file.robots.values()
    assert isinstance(robot, Cosserat)
    changes: dict[str, Any] = {"sim": SimulatedArm(payload_g=3.0, payload_at_s=2.0)}
    if sensed:
        changes |= {"sense": sensing(robot), "load": "estimated"}
    loaded.file.robots["arm"] = robot.model_copy(update=changes)
    return loaded


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


def run(name: str, ticks: int) -> np.ndarray:
    """Times of a tick without and with sensing, and of what it adds [us], shape ``(3, ticks)``."""
    files = {sensed: arm_file(name, sensed) for sensed in (False, True)}
    processes = {sensed: VirtualProcess(loaded, RATE_HZ, Silent()) for sensed, loaded in files.items()}
    model = processes[False].engine.robots.configs[0].model
    x, y, z = model.forward(tuple(0.4 * top for top in model.upper)).tip_m
    (stage,) = [each for each in processes[True].engine._before if isinstance(each, LoadSensingStage)]
    sensing: Any = stage
    sensing.before = Timed(sensing.before)
    times = np.zeros((3, ticks + WARM_UP))
    for process in processes.values():
        process.engine.arm()
    for k in range(ticks + WARM_UP):
        angle = 2.0 * math.pi * k / RATE_HZ / 4.0
        target = Target(tip_m=(x + 4e-3 * math.cos(angle), y + 4e-3 * math.sin(angle), z))
        for sensed in (False, True) if k % 2 else (True, False):
            process = processes[sensed]
            process.begin()
            if process.engine.robots.armed:
                process.engine.obey(Rows({"arm": target}), process.tick)
            sensing.before.spent_ns = 0
            begin = time.thread_time_ns()
            process.turn()
            times[int(sensed), k] = time.thread_time_ns() - begin
            if sensed:
                times[2, k] = sensing.before.spent_ns
    for process in processes.values():
        process.close()
    return times[:, WARM_UP:] / 1e3


def measure(name: str, ticks: int) -> bool:
    """Print the times of one arm; False when the bar is not met."""
    without, sensed, added = np.min([run(name, ticks) for _ in range(TIMES)], axis=0)
    print(f"{name}, {ticks} ticks of each, the shortest of {TIMES} runs")
    _row("tick without", without)
    _row("tick with sensing and compensation", sensed)
    _row("added", added)
    p99 = float(np.percentile(added, 99.0))
    print(
        f"  p99 of what is added: {p99:.0f} us, bar {BAR_US:.0f} us: {'met' if p99 <= BAR_US else 'NOT MET'}"
    )
    return p99 <= BAR_US


def _row(name: str, values_us: np.ndarray) -> None:
    p50, p99, p999 = np.percentile(values_us, [50.0, 99.0, 99.9])
    print(f"  {name:36s} p50 {p50:6.0f}  p99 {p99:6.0f}  p99.9 {p999:6.0f} us")


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 4_000
    met = [measure(arm, count) for arm in ("stiffflop1", "stiffflop2")]
    sys.exit(not all(met))
