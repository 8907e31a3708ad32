"""Record the golden sessions again: ``python -m tests.golden.make [NAME ...]`` in the root of the repository.

One short session in virtual time per shipped robot file: from where the devices stand to the rest pose (or
`CENTRES`) and through a few reachable tips around it, which the preflight accepts, then stopped by the file's
policy. Needed when a change
of commands is intended, or a robot file changed; replay the old ones first to see what changed and where.
"""

from __future__ import annotations

import io
import itertools
import sys
from pathlib import Path
from typing import Final

import numpy as np

from contid.control.engine.cycle import OnEnd
from contid.control.engine.virtual import run_virtual
from contid.control.engine.wiring import build_robot_configs, chain_guards
from contid.control.process.pipe import RunSetup
from contid.control.tick.config import RobotConfig
from contid.control.tick.preflight.rows import Preflight
from contid.robot_file.load import LoadedFile, load_robot_file, with_mock
from contid.session.recording_observer import RecordingObserver
from contid.targets import Actuation
from contid.trajectory.read import read_trajectory
from contid.trajectory.timed import Trajectory

FOLDER: Final = Path(__file__).parent
CONFIGS: Final = Path("configs")
#: Slow enough for small files, fast enough for every limit to bind.
RATE_HZ: Final = 100.0
#: Rows, and how far around the rest pose they go, as a share of an axis's travel.
TIMES_S: Final = (0.0, 0.2, 0.4, 0.6, 0.8)
REACH: Final = 0.03
#: Where not around the rest pose, which is at the edge of the reach of arms that lengthen, inflate or have a
#: backbone of given length: share of each axis's travel, of one axis after the other where there are several.
CENTRES: Final[dict[str, tuple[float, ...]]] = {
    **dict.fromkeys(("chambers3", "stiffflop1", "stiffflop2"), (0.5,)),
    **dict.fromkeys(("trirack", "trirack2"), (0.1,)),
    **dict.fromkeys(("bend1", "ftdcr_v4", "tendon3"), (0.6, 0.45, 0.45)),
}
#: Of long racks, and of six drives at once, the same share is a long way.
REACHES: Final = {"trirack": 0.005, "trirack2": 0.005, "trunk": 0.01}
#: How far commands may differ [mm or bar]: a fifth of the least move by a mutation of test_golden (cbha).
TOLERANCE: Final = 1e-5


def names() -> list[str]:
    """Shipped robot files; emulated twins differ in their ports only."""
    return sorted(path.stem for path in CONFIGS.glob("*.yaml") if not path.stem.endswith(".emulated"))


def trajectory(loaded: LoadedFile, rate_hz: float) -> Trajectory:
    """Tips of actuations around the rest pose, as CSV through the reader that users have."""
    head, columns = ["t_s"], []
    robots = loaded.driven
    for config in build_robot_configs(loaded, rate_hz):
        robot = robots[config.name]
        axes = "xyz"[: robot.dimension]
        head += [f"{config.name}.{axis}_mm" for axis in axes]
        centre = _centre(config, CENTRES.get(loaded.file.name))
        reach = REACHES.get(loaded.file.name, REACH)
        columns.append([_tip(config, centre, reach, robot.dimension, k) for k in range(len(TIMES_S))])
    lines = [",".join(head)]
    for k, time_s in enumerate(TIMES_S):
        cells = [repr(value) for column in columns for value in column[k]]
        lines.append(",".join([repr(time_s), *cells]))
    return read_trajectory(io.StringIO("\n".join(lines)), "golden.csv", robots)


def _centre(config: RobotConfig, shares: tuple[float, ...] | None) -> Actuation:
    """Actuation of the first tip: that of the rest pose, or shares of the axes' travels."""
    model = config.model
    if shares is None:
        return config.rest[: len(model.lower)]
    travels = zip(itertools.cycle(shares), model.lower, model.upper, strict=False)
    return tuple(a + share * (b - a) for share, a, b in travels)


def _tip(config: RobotConfig, centre: Actuation, reach: float, dimension: int, k: int) -> list[float]:
    """Tip number ``k`` in the world [mm]; the first one is that of ``centre``."""
    model = config.model
    travel = np.subtract(model.upper, model.lower)
    share = reach * np.sin(k * (1.0 + np.arange(len(travel)))) if k else 0.0
    actuation = np.clip(np.asarray(centre) + share * travel, model.lower, model.upper)
    tip = config.frame.point_in_world(model.forward(tuple(actuation.tolist())).tip_m)
    return [1e3 * value for value in tip[:dimension]]


def record(name: str, path: Path, robot_file: Path | None = None) -> None:
    """Record one session."""
    loaded = with_mock(load_robot_file(robot_file or CONFIGS / f"{name}.yaml"))
    rows = trajectory(loaded, RATE_HZ)
    Preflight(build_robot_configs(loaded, RATE_HZ), chain_guards(loaded)).trajectory(rows, "golden.csv")
    recording = RecordingObserver(
        path, {"mock": "True", "unreachable": "refuse", "input": "golden.csv"}, host="golden"
    )
    sink = recording.follow(RunSetup(loaded, RATE_HZ, Path(), rows, OnEnd.STOP, attended=False))
    report = run_virtual(loaded, RATE_HZ, rows, sinks=[sink], on_end=OnEnd.STOP)
    recording.detach()
    if report.exit_code:
        raise SystemExit(f"{name}: {report}")


if __name__ == "__main__":
    for chosen in sys.argv[1:] or names():
        target = FOLDER / f"{chosen}.mcap"
        target.unlink(missing_ok=True)
        record(chosen, target)
        print(f"{target}: {target.stat().st_size / 1e3:.0f} kB")
