"""A finger driven from Python: a point, a circle, and its telemetry.

Start a daemon first: `contid run finger --mock < /dev/null`, then `python examples/remote.py [SOCKET]`.
"""

import math
import sys

from contid.client import Client

with Client(sys.argv[1] if len(sys.argv) > 1 else None, name="example") as robot:
    robot.resume()
    name, described = next(iter(robot.describe()["robots"].items()))
    print(name, "understands", ", ".join(described["columns"]))

    robot.move({"x_mm": 50.0, "y_mm": 75.0})
    print("tip at", robot.status()["robots"][name]["tip_mm"])

    # Two seconds of circle, checked as a whole before it is played.
    angles = [2.0 * math.pi * step / 100 for step in range(101)]
    circle = [(a / math.pi, 45.0 + 5.0 * math.cos(a), 75.0 + 5.0 * math.sin(a)) for a in angles]
    robot.stream(["t_s", "x_mm", "y_mm"], circle)

    for number, frame in enumerate(robot.telemetry(rate_hz=50, fields=["state", "tip_mm"])):
        print(frame["tick"], frame["robots"][name])
        if number == 4:
            break
