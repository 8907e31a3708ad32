"""Shipped tendon robots, their tips by rotation matrices of scipy, and bends inside their limits."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from contid.kinematics.tendon.model import TendonModel
from contid.robot_file.load import load_named
from contid.robot_file.tendon.robot import TendonRobot


def shipped(name: str = "tendon3") -> TendonModel:
    (robot,) = load_named(name).file.robots.values()
    assert isinstance(robot, TendonRobot)
    return TendonModel(robot)


def placed(model: TendonModel, bends: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tip, tangent and end of the first section: chords of circles, turned by scipy."""
    at, turned = np.array([0.0, 0.0, model.geometry.base_offset_m]), Rotation.identity()
    ends = []
    for k, section in enumerate(model.geometry.sections):
        u, v = bends[2 * k : 2 * k + 2]
        theta = math.hypot(u, v)
        turn = Rotation.from_rotvec([-v, u, 0.0])
        chord = section.length_m * (math.sin(theta / 2) / (theta / 2) if theta else 1.0)
        at = at + turned.apply(Rotation.from_rotvec([-v / 2, u / 2, 0.0]).apply([0.0, 0.0, chord]))
        turned = turned * turn
        at = at + turned.apply([0.0, 0.0, section.rigid_m])
        ends.append(at)
    tip = at + turned.apply(model.geometry.tip_offset_m)
    return tip, turned.apply([0.0, 0.0, 1.0]), ends[0]


def random_bends(model: TendonModel, count: int, seed: int) -> np.ndarray:
    """Bends inside every limit, dense up to the limits."""
    rng = np.random.default_rng(seed)
    feasible = model.feasible
    lengths = np.repeat(feasible.sections.backbone_m, 2)
    return np.array(
        [feasible.pulled(rng.uniform(feasible.low, feasible.high)) / lengths for _ in range(count)]
    )


def frame_of(model: TendonModel, bends: np.ndarray) -> np.ndarray:
    """Frame of the tip: rotations of scipy in series."""
    turned = Rotation.identity()
    for u, v in bends.reshape(-1, 2):
        turned = turned * Rotation.from_rotvec([-v, u, 0.0])
    return np.asarray(turned.as_matrix())


def vec(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
