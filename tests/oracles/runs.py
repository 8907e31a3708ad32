"""Random runs: ``python -m tests.oracles.runs --cases 1000``; no run ends with exit 0 and a wrong tip.

Paths are Fourier series (smooth) or broken lines (rough) of the tip about random postures, slow enough for
the check of a run; loads vary along them, and pneumatic arms are armed wherever their devices stand. Tips of
commands are those of the textbook (`arcs`), or of `forward` for pneumatic arms.
"""

from __future__ import annotations

import argparse
import io
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from contid.control.engine.virtual import run_virtual
from contid.control.engine.wiring import build_robot_configs, record_layout
from contid.control.tick.config import RobotConfig
from contid.control.tick.preflight.rows import Preflight, TooFastError
from contid.control.tick.supervisor import Mode
from contid.errors import BadInputError
from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.arc.section_model import SectionModel
from contid.kinematics.array import Array
from contid.kinematics.model import build_model
from contid.robot_file.load import LoadedFile, load_named, with_mock
from contid.trajectory.read import read_trajectory
from contid.trajectory.timed import Trajectory
from tests.oracles.arcs import random_posture, tip_and_tangent

RATE_HZ = 100.0
#: Robot -> allowed distance of a tip from its target [mm], and how far paths go about a posture [mm].
ROBOTS = {
    "trirack": (1e-6, 30.0),
    "trirack2": (1e-6, 60.0),
    "cbha": (1e-6, 20.0),
    "stiffflop1": (0.05, 3.0),
    "stiffflop2": (0.05, 6.0),
}
LOADED = ("stiffflop1", "stiffflop2")
MOST_LOAD_N = 0.08
MOST_BENT_RAD = 1.0
#: The slowest that a path which is too fast is tried.
STRETCHES = 4
#: The longest that a path is run; stretched, some take hours.
LONGEST_S = 60.0


@dataclass(frozen=True)
class Outcome:
    """How a random run ended.

    Attributes:
        kind: ``refused``, ``long`` (not run), ``followed``, ``fault`` (exit 3) or ``wrong``: exit 0 with a
            tip off its target.
        off_mm: greatest distance of the commanded tip from its target in RUN.
        message: why it was refused, or the fault.
    """

    kind: str
    off_mm: float = 0.0
    message: str = ""


class _Tips:
    """A sink that compares every command in RUN with its target."""

    def __init__(self, loaded: LoadedFile, tip: Callable[[Array, Array], Array]) -> None:
        self._layout = record_layout(loaded, RATE_HZ)
        self._tip = tip
        self.off_m = 0.0

    def write(self, values: list[float]) -> None:
        (robot,) = self._layout.decode(tuple(values)).robots
        if robot.mode == Mode.RUN and robot.tip_error_m == robot.tip_error_m:
            command = np.array([axis.command for axis in robot.axes])
            off_m = float(np.linalg.norm(self._tip(command, np.array(robot.load_n)) - robot.tip_m))
            self.off_m = max(self.off_m, off_m)

    def event(self, event: object) -> None:
        """Events are not compared."""


def tip_of(config: RobotConfig, loaded: LoadedFile) -> Callable[[Array, Array], Array]:
    """The tip in the world of a command under a load in the world."""
    (robot,) = loaded.file.robots.values()
    model, frame = build_model(robot), config.frame

    def tip(command: Array, load_n: Array) -> Array:
        if isinstance(model, SectionModel):
            own = tip_and_tangent(model.feasible, command[: len(model.axis_names)])[0]
            return np.array(frame.point_in_world(tuple(own.tolist())))
        load_in_base = frame.vector_in_base(tuple(load_n.tolist()))
        return np.array(
            frame.point_in_world(config.model.forward(tuple(command.tolist()), load_in_base).tip_m)
        )

    return tip


def path(name: str, config: RobotConfig, feasible: Feasible | None, rng: np.random.Generator) -> str:
    """A random trajectory as CSV; its middle is within reach, the rest need not be."""
    low, high = np.array(config.model.lower), np.array(config.model.upper)
    posture = low + rng.uniform(0.1, 0.9, len(low)) * (high - low)
    if feasible is not None:
        posture[: len(feasible.low)] = random_posture(feasible, rng, MOST_BENT_RAD)
    loads = np.zeros((2, 3))
    if name in LOADED and rng.random() < 0.8:
        loads = rng.normal(size=(2, 3))
        loads *= (rng.uniform(0.0, MOST_LOAD_N, 2) / np.linalg.norm(loads, axis=1))[:, None]
        if rng.random() < 0.5:
            loads[1] = loads[0]
    pose = config.model.forward(
        tuple(posture.tolist()), config.frame.vector_in_base(tuple(loads[0].tolist()))
    )
    middle = 1e3 * np.array(config.frame.point_in_world(pose.tip_m))
    rows, size = int(rng.integers(3, 12)), ROBOTS[name][1] * rng.uniform(0.1, 1.0)
    share = np.sort(rng.random(rows))
    share = (share - share[0]) / (share[-1] - share[0])
    if rng.random() < 0.5:
        waves = rng.normal(size=(3, 2, 3)) / np.arange(1, 4)[:, None, None]
        angles = 2.0 * np.pi * np.arange(1, 4)[:, None] * share
        way = np.einsum("kt,kx->tx", np.sin(angles), waves[:, 0]) + np.einsum(
            "kt,kx->tx", np.cos(angles), waves[:, 1]
        )
    else:
        way = rng.uniform(-1.0, 1.0, (rows, 3))
    tips = middle + size * way / np.abs(way).max()
    times = np.round(share * rng.uniform(0.3, 2.0), 4)
    columns = ["t_s", "x_mm", "y_mm", "z_mm"]
    table = [np.maximum.accumulate(times + 2e-3 * np.arange(rows))[:, None], tips]
    if name in ("trirack2", "cbha", "stiffflop2") and rng.random() < 0.3:
        columns += ["ax", "ay", "az"]
        world = np.array(config.frame.vector_in_world(pose.direction))
        table.append(world + 0.1 * rng.normal(size=(rows, 3)))
    if loads.any():
        columns += ["load.fx_n", "load.fy_n", "load.fz_n"]
        table.append(loads[0] + share[:, None] * (loads[1] - loads[0]))
    cells = np.concatenate(table, axis=1)
    return "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in cells.tolist())])


def standing(name: str, loaded: LoadedFile, rng: np.random.Generator) -> LoadedFile:
    """The same robot; the regulators of a pneumatic arm stand at random pressures when they are armed."""
    if name not in LOADED or rng.random() < 0.3:
        return loaded
    buses = {}
    for bus, wiring in loaded.buses.items():
        axes = tuple(
            (axis, options.model_copy(update={"start_bar": float(rng.uniform(0.0, 1.4)), "noise_bar": 0.0}))
            for axis, options in wiring.axes
        )
        buses[bus] = replace(wiring, axes=axes)
    return replace(loaded, buses=buses)


def accepted(config: RobotConfig, trajectory: Trajectory) -> Trajectory:
    """What `contid run --stretch` would follow.

    Raises:
        BadInputError: it is refused.
    """
    for _ in range(STRETCHES):
        try:
            return Preflight([config]).trajectory(trajectory, "t.csv")
        except TooFastError as error:
            trajectory = trajectory.stretched(1.3 * error.slowdown)
    return Preflight([config]).trajectory(trajectory, "t.csv")


def random_run(name: str, seed: int) -> Outcome:
    """One random run of a shipped robot."""
    rng = np.random.default_rng(seed)
    loaded = standing(name, with_mock(load_named(name)), rng)
    (config,) = build_robot_configs(loaded, RATE_HZ)
    (robot_model,) = (build_model(robot) for robot in loaded.file.robots.values())
    feasible = robot_model.feasible if isinstance(robot_model, SectionModel) else None
    try:
        text = path(name, config, feasible, rng)
        read = read_trajectory(io.StringIO(text), "t.csv", loaded.driven)
        trajectory = accepted(config, read)
    except BadInputError as error:
        return Outcome("refused", message=str(error).splitlines()[0])
    if trajectory.end_s - trajectory.start_s > LONGEST_S:
        return Outcome("long", message=f"{trajectory.end_s:.4g} s")
    tips = _Tips(loaded, tip_of(config, loaded))
    report = run_virtual(loaded, RATE_HZ, trajectory, sinks=[tips])
    off_mm = 1e3 * tips.off_m
    (robot,) = report.robots.values()
    if report.exit_code:
        return Outcome("fault", off_mm, robot["message"])
    return Outcome("wrong" if off_mm > ROBOTS[name][0] else "followed", off_mm)


def main() -> int:
    """Count for every robot; exit 1 when a run ended with exit 0 and a wrong tip."""
    parser = argparse.ArgumentParser(prog="python -m tests.oracles.runs")
    parser.add_argument("--cases", type=int, default=100, help="for each robot")
    parser.add_argument("--seed", type=int, default=0, help="of the first case")
    parser.add_argument("--robots", nargs="*", default=list(ROBOTS))
    given = parser.parse_args()
    held = True
    for name in given.robots:
        kinds: Counter[str] = Counter()
        worst = 0.0
        for seed in range(given.seed, given.seed + given.cases):
            found = random_run(name, seed)
            kinds[found.kind] += 1
            if found.kind in ("wrong", "fault"):
                print(f"{name} seed {seed}: {found}", flush=True)
            if found.kind == "followed":
                worst = max(worst, found.off_mm)
        held &= kinds["wrong"] == 0
        counts = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))
        print(f"{name:10} {given.cases} runs: {counts}; worst tip of the followed {worst:.2g} mm", flush=True)
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
