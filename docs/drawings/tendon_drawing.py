"""Draw docs/images/tendon.svg of docs/robots/tendon.md: ``python docs/drawings/tendon_drawing.py``.

Backbone, discs and tendons are those of the model for a bent `tendon3`; beside it a disc seen from the tip.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt

from contid.kinematics.model import build_model
from contid.kinematics.tendon.geometry import TendonGeometry, forward
from contid.kinematics.tendon.model import TendonModel
from contid.robot_file.load import load_named

IMAGE = Path(__file__).parents[1] / "images" / "tendon.svg"
COLOURS = ("#1b4965", "#ca6702", "#2d6a4f")
BENDS = np.array([0.9, 0.0, -0.5, 0.5, 0.4, -0.9])
DISCS = 6  # drawn per section


def frames(model: TendonModel, bends: np.ndarray) -> list[tuple[int, np.ndarray, np.ndarray]]:
    """Section, position [m] and rotation of the drawn discs, from the base on."""
    out = []
    geometry = model.geometry
    origin, turned = np.array([0.0, 0.0, geometry.base_offset_m]), np.eye(3)
    for k, section in enumerate(geometry.sections):
        for share in np.linspace(0.0, 1.0, DISCS):
            part = TendonGeometry((replace(section, length_m=share * section.length_m, rigid_m=0.0),))
            at = forward(part, share * bends[2 * k : 2 * k + 2])
            out.append((k, origin + turned @ at.discs_m[0], turned @ at.rotations[0]))
        _, origin, turned = out[-1]
    return out


def main() -> None:
    """Write the drawing."""
    (robot,) = load_named("tendon3").file.robots.values()
    model = build_model(robot)
    assert isinstance(model, TendonModel)
    mpl.rcParams["svg.hashsalt"] = "contid"  # the same file every time
    figure = plt.figure(figsize=(9.0, 4.6))
    side = figure.add_axes((0.02, 0.05, 0.55, 0.9))
    discs = frames(model, BENDS)
    points = 1e3 * np.array([position for _, position, _ in discs])
    side.plot(points[:, 0], points[:, 2], color="black", linewidth=2.5, zorder=2)
    for _, position, rotation in discs:
        edge = 1e3 * (position + 0.011 * np.outer([-1.0, 1.0], rotation[:, 0]))
        side.plot(edge[:, 0], edge[:, 2], color="grey", linewidth=3, zorder=3)
    for s, section in enumerate(model.geometry.sections):
        for arm in section.arms:
            line = 1e3 * np.array([p + r[:, :2] @ arm for k, p, r in discs if k <= s])
            side.plot(line[:, 0], line[:, 2], color=COLOURS[s], linewidth=1, zorder=4)
        end = points[DISCS * (s + 1) - 1]
        side.annotate(f"end of section {s + 1}", (end[0], end[2]), (end[0] + 16, end[2] - 8), fontsize=9)
    side.set_aspect("equal")
    side.set_xlabel("x (mm)")
    side.set_ylabel("z (mm)")
    side.set_xlim(-40, 250)
    face = figure.add_axes((0.62, 0.15, 0.36, 0.7))
    for s, section in enumerate(model.geometry.sections):
        for t, arm in enumerate(1e3 * section.arms):
            face.plot(*arm, "o", color=COLOURS[s], markersize=7)
            face.annotate(f"s{s + 1}.t{t + 1}", arm, 1.33 * arm, fontsize=8, ha="center", va="center")
    face.add_patch(plt.Circle((0.0, 0.0), 9.5, fill=False, color="grey"))
    face.plot(0.0, 0.0, "ko", markersize=5)
    face.set_title("disc, seen from the tip", fontsize=10)
    face.set_aspect("equal")
    face.set_xlim(-14, 14)
    face.set_ylim(-14, 14)
    face.axis("off")
    figure.savefig(IMAGE, metadata={"Date": None})


if __name__ == "__main__":
    main()
