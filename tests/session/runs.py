"""Short runs in virtual time that fill every key of a session: ``python -m tests.session.runs FOLDER``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from contid.control.engine import messages as msg
from contid.control.engine.cycle import OnEnd
from contid.control.engine.virtual import run_virtual
from contid.control.engine.wiring import build_robot_configs
from contid.control.process.pipe import RunSetup
from contid.control.tick.config import RobotConfig
from contid.robot_file.load import LoadedFile, parse_robot_file, with_mock
from contid.session.recording_observer import RecordingObserver
from contid.targets import Pose, Target
from contid.trajectory.timed import Trajectory
from tests.support.fingers import circle, fingers

CONFIGS: Final = Path(__file__).parents[2] / "configs"
RATE_HZ: Final = 100.0
Orders = dict[int, list[msg.Message]]
#: One section whose model has no error, and a tracker.
_ROWS: Final = ", ".join(["[0.0]"] * 11)
SENSE: Final = f"""    sim: {{payload_g: 2}}
    sense:
      load:
        calibration:
          {{offset_bar: [0, 0, 0], gain: [0, 0, 0], loop_bar: [0, 0, 0], modulus: [0], moment: [0],
           axis_sigma_bar: 0.001, tip_sigma_mm: 0.1, covariance_factor: [{_ROWS}]}}
"""


def record_virtual(
    path: Path,
    loaded: LoadedFile,
    trajectory: Trajectory | None,
    orders: Mapping[int, Sequence[msg.Message]] | None = None,
    ticks: int | None = None,
    *,
    on_end: OnEnd = OnEnd.STOP,
    rate_hz: float = 200.0,
) -> Path:
    """Record a run in virtual time."""
    recording = RecordingObserver(path, {"mock": "False", "input": "test"}, host="test")
    sink = recording.follow(RunSetup(loaded, rate_hz, Path(), trajectory, on_end, attended=False))
    for messages in (orders or {}).values():
        for message in messages:
            recording.before_order(message)
    run_virtual(loaded, rate_hz, trajectory, sinks=[sink], orders=orders, ticks=ticks, on_end=on_end)
    recording.detach()
    return path


def tracked_hand(path: Path) -> Path:
    """One finger with tip targets and a tracker, the other with targets for its racks."""
    loaded = _simulated("hand")
    left, right = build_robot_configs(loaded, RATE_HZ)
    tip, direction = _in_world(left, _around(left, 1))
    orders: Orders = {
        5: [msg.Rows({"left": Target(tip_m=tip), "right": Target(actuation=right.rest)})],
        20: [msg.Measured("left", tip, None, 0.004)],
        40: [msg.Measured("left", tip, direction, 0.004), msg.Hold()],
        60: [msg.EndOfRows()],
    }
    return record_virtual(path, loaded, None, orders, ticks=250, rate_hz=RATE_HZ)


def loaded_arm(path: Path) -> Path:
    """An arm senses the weight at its tip; targets: tip, tip and direction, pressures."""
    loaded = _simulated("stiffflop1", SENSE)
    (config,) = build_robot_configs(loaded, RATE_HZ)
    tip, direction = _in_world(config, _around(config, 1))
    load = (0.0, 0.0, 0.02)
    orders: Orders = {
        5: [msg.Rows({config.name: Target(tip_m=tip, load_n=load)})],
        40: [msg.Rows({config.name: Target(tip_m=tip, direction=direction)})],
        55: [msg.Rows({config.name: Target(actuation=config.rest)})],
        60: [msg.EndOfRows()],
    }
    return record_virtual(path, loaded, None, orders, ticks=80, rate_hz=RATE_HZ)


def bent_cbha(path: Path) -> Path:
    """Two sections, wrist and gripper; targets: mid-point and tip, frame of the tip, length of every tube."""
    loaded = _simulated("cbha")
    (config,) = build_robot_configs(loaded, RATE_HZ)
    pose = _around(config, 1)
    tip, _ = _in_world(config, pose)
    mid = config.frame.point_in_world(pose.mid_m)
    turn = np.reshape(config.frame.rotation, (3, 3)) @ np.reshape(pose.rotation, (3, 3))
    rest = config.rest[: len(config.axes) - config.extra_axes]
    orders: Orders = {
        5: [msg.Rows({config.name: Target(tip_m=tip, mid_m=mid, extra={"wrist": 0.01})})],
        30: [msg.Rows({config.name: Target(tip_m=tip, rotation=tuple(turn.ravel().tolist()))})],
        40: [msg.Rows({config.name: Target(actuation=rest, extra={"gripper": 0.005})})],
        60: [msg.EndOfRows()],
    }
    return record_virtual(path, loaded, None, orders, ticks=80, rate_hz=RATE_HZ)


def faulty_fingers(path: Path) -> Path:
    """A servo that does not answer at first, skipped ticks, an overload."""
    faults = (
        "{at_s: 0.05, kind: silent, axis: f1.left, for_s: 0.05}",
        "{at_s: 0.7, kind: late, for_s: 0.05, delay_ms: 12}",
        "{at_s: 0.8, kind: overload, axis: f0.right}",
    )
    text = fingers(2, options="\n  - ".join(("faults:", *faults)))
    loaded = parse_robot_file(text, "fingers.yaml")
    return record_virtual(path, loaded, circle(loaded, period_s=1.0), ticks=450)


RUNS: Final[dict[str, Callable[[Path], Path]]] = {
    "tracked_hand": tracked_hand,
    "loaded_arm": loaded_arm,
    "bent_cbha": bent_cbha,
    "faulty_fingers": faulty_fingers,
}


def _simulated(name: str, more: str = "") -> LoadedFile:
    """A shipped robot, with more lines in its first robot."""
    text = (CONFIGS / f"{name}.yaml").read_text(encoding="utf-8")
    text = text.replace("    stop: {on_end", f"{more}    stop: {{on_end", 1)
    return with_mock(parse_robot_file(text, f"{name}.yaml"))  # its name: committed files have no paths


def _around(config: RobotConfig, k: int) -> Pose:
    """A pose near the rest pose."""
    model = config.model
    travel = np.asarray(model.upper) - np.asarray(model.lower)
    share = 0.03 * np.sin(k * (1.0 + np.arange(len(travel))))
    rest = np.asarray(config.rest[: len(travel)])
    return model.forward(tuple(np.clip(rest + share * travel, model.lower, model.upper).tolist()))


def _in_world(
    config: RobotConfig, pose: Pose
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    return config.frame.point_in_world(pose.tip_m), config.frame.vector_in_world(pose.direction)


def main() -> None:
    """Record all runs."""
    folder = Path(sys.argv[1])
    for name, run in RUNS.items():
        print(run(folder / f"{name}.mcap"))


if __name__ == "__main__":
    main()
