"""Modes of a robot at a pose and over its workspace, for ``contid modes``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Final

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.robot_file.robot import RobotDescription
from contid.units import MM_PER_M
from contid_dynamics.arm import MovingArm
from contid_dynamics.rod import STRAINS, Modes

#: Change of the strains by which shapes are drawn, in modal coordinates at unit mass [sqrt(kg) m].
_STEP: Final = 1e-6
#: Share of the length of a mode's shape below which the tip stands still.
_STANDS: Final = 1e-3
SEED: Final = 1
#: Elements of a section for modes, at least: frequencies are within 0.5 % of those of many more.
_ELEMENTS: Final = 12


@dataclass(frozen=True)
class VibrationMode:
    """One mode.

    Attributes:
        frequency_hz: damped frequency; 0 where the damping is above critical.
        ratio: damping ratio.
        settles_s: time until 1 % of a swing is left.
        direction: unit vector along which the tip moves, empty where it stands.
        shape_mm: displacement of every node for a displacement of 1 mm of the one that moves most.
        per_unit_m: displacement of that node at unit modal mass [m / (sqrt(kg) m)].
    """

    frequency_hz: float
    ratio: float
    settles_s: float
    direction: tuple[float, ...]
    shape_mm: tuple[tuple[float, ...], ...]
    per_unit_m: float


@dataclass(frozen=True)
class PoseModes:
    """The slowest modes at a pose.

    Attributes:
        tip_mm: the tip in the base frame.
        nodes_mm: the backbone, from the base on.
        modes: slowest first.
    """

    tip_mm: tuple[float, ...]
    nodes_mm: tuple[tuple[float, ...], ...]
    modes: tuple[VibrationMode, ...]

    def to_json(self) -> dict[str, object]:
        """The numbers for ``--json``; None for a mode that never stops, which has no finite time."""
        found = asdict(self)
        for mode in found["modes"]:
            for key in ("ratio", "settles_s"):
                mode[key] = mode[key] if math.isfinite(mode[key]) else None
        return found


def pose_modes(
    robot: RobotDescription, actuation: Sequence[float], count: int, payload_g: float = 0.0
) -> PoseModes:
    """Modes of a robot that rests under an actuation [m or Pa].

    Raises:
        ContidError: the robot has no moving body.
        ArithmeticError: no equilibrium was found.
    """
    arm = pose_arm(robot, payload_g)
    arm.settle(actuation)
    return modes_of(arm, arm.rod.modes(), count)


def modes_of(arm: MovingArm, found: Modes, count: int) -> PoseModes:
    """The numbers of the slowest modes that were found of an arm at rest."""
    nodes = arm.rod.poses
    strain = arm.rod.strain
    modes = tuple(_mode(arm, found, k, nodes, strain) for k in range(min(count, len(found.ratio))))
    return PoseModes(
        tuple((MM_PER_M * arm.tip_m).tolist()),
        tuple(tuple(point) for point in (MM_PER_M * nodes[:, :3]).tolist()),
        modes,
    )


def pose_arm(robot: RobotDescription, payload_g: float = 0.0) -> MovingArm:
    """The arm whose modes are computed: at one pose, over many and for schedules.

    Raises:
        ContidError: the robot has no moving body.
    """
    given = getattr(robot, "dynamics", None)
    return MovingArm(robot, payload_g * 1e-3, None if given is None else max(given.elements, _ELEMENTS))


def range_over_poses(
    robot: RobotDescription, poses: int, count: int, payload_g: float = 0.0, *, undamped: bool = False
) -> list[tuple[float, float]]:
    """Least and greatest frequency [Hz] of each mode over random actuations within the limits.

    Args:
        robot: its description.
        poses: number of actuations.
        count: number of modes, the slowest first.
        payload_g: mass on the tip.
        undamped: the frequencies without damping; else the damped ones, as `VibrationMode` has them.

    Raises:
        ContidError: none of them has an equilibrium.
    """
    rng = np.random.default_rng(SEED)
    arm = pose_arm(robot, payload_g)
    low, high = np.array(robot.lower), np.array(robot.upper)
    rows = []
    for _ in range(poses):
        actuation = low + rng.random(len(low)) * (high - low)
        try:
            arm.settle(actuation.tolist())
        except ArithmeticError:
            continue  # tendons that pull against each other beyond what bends the backbone
        found = arm.rod.modes()
        rows.append((found.frequency_hz if undamped else _damped_hz(found))[:count])
    if not rows:
        raise ContidError(f"no equilibrium at any of {poses} random poses; ask for more")
    return list(zip(np.min(rows, axis=0).tolist(), np.max(rows, axis=0).tolist(), strict=True))


def _damped_hz(found: Modes) -> Array:
    """Damped frequencies [Hz], 0 above critical damping."""
    damped: Array = found.frequency_hz * np.sqrt(np.maximum(1.0 - found.ratio**2, 0.0))
    return damped


def _mode(arm: MovingArm, found: Modes, k: int, nodes: Array, strain: Array) -> VibrationMode:
    """Mode ``k`` of an arm at rest with these nodes and strains; its shape is a difference of poses."""
    free = arm.rod.elements.strains
    change = np.zeros((arm.rod.count, STRAINS))
    change[:, :free] = found.strain[k].reshape(-1, free)
    arm.rod.put(strain + _STEP * change)
    moved = (arm.rod.poses - nodes) / _STEP
    tip = arm.tips_of(moved[-1:])[0]
    arm.rod.put(strain)
    most = max(float(np.linalg.norm(moved[:, :3], axis=1).max()), 1e-12)
    length = float(np.linalg.norm(tip))
    ratio, rate = float(found.ratio[k]), 2.0 * math.pi * float(found.frequency_hz[k])
    # Above critical damping the slower of the two exponentials counts: rate (ratio - sqrt(ratio^2 - 1)).
    decay = ratio * rate if ratio < 1.0 else rate / (ratio + math.sqrt(ratio * ratio - 1.0))
    return VibrationMode(
        float(_damped_hz(found)[k]),
        ratio,
        math.log(100.0) / decay if decay > 0.0 else math.inf,
        tuple((tip / length).tolist()) if length > _STANDS * most else (),
        tuple(tuple(point) for point in (moved[:, :3] / most).tolist()),
        most,
    )
