"""Figures of docs/sensing.md: ``python -m tests.sense.squeeze_figures``."""

from __future__ import annotations

import itertools
import math

import numpy as np

from contid.control.engine.events.robots import SqueezeChanged
from contid.robot_file.load import parse_robot_file, with_mock
from tests.sense.squeeze_runs import FACE_MM, closing, hand_text, run

STIFFNESSES = (0.5, 3.0, 50.0)
FORCES_N = (2.0, 3.0, 5.0)
FRICTIONS = (0.8, 1.0, 1.2)
TURNED_DEG = (0.0, 20.0)


def main() -> None:
    """Print how far the held force is from its set-point."""
    rows = []
    for stiffness, goal_n, friction, turned in itertools.product(
        STIFFNESSES, FORCES_N, FRICTIONS, TURNED_DEG
    ):
        angle = math.radians(turned)
        text = hand_text(stiffness).replace(
            f"point_mm: [{FACE_MM}, 0, 0], normal: [-1, 0, 0]",
            f"point_mm: [{FACE_MM}, 75, 0], normal: [{-math.cos(angle)}, {math.sin(angle)}, 0]",
        )
        found = run(with_mock(parse_robot_file(text, "hand.yaml")), closing(goal_n), 12.0, friction)
        reached = [event for event in found.events if isinstance(event, SqueezeChanged)]
        ok = [event.what for event in reached] == ["reached"]
        held = np.array(found.push_n[-400:])
        seconds = (reached[0].tick - next(i for i, push in enumerate(found.push_n) if push)) / 200.0
        rows.append((turned, friction, ok, np.mean(held) / goal_n, max(found.push_n) / goal_n, seconds))
    print(f"{sum(row[2] for row in rows)} of {len(rows)} reached")
    for turned, friction in itertools.product(TURNED_DEG, FRICTIONS):
        part = [row for row in rows if row[:2] == (turned, friction)]
        off = [100.0 * (row[3] - 1.0) for row in part]
        most = [100.0 * (row[4] - 1.0) for row in part]
        took = [row[5] for row in part]
        print(
            f"turned {turned:g} deg, friction x {friction:g}: off by {min(off):.1f} to {max(off):.1f} %, "
            f"most {max(most):.1f} % above, {np.median(took):.1f} s from touch to force (max {max(took):.1f})"
        )


if __name__ == "__main__":
    main()
