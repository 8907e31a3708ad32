"""A tracker: sends measured tip positions of a robot to a running daemon, a hundred times a second.

    contid run finger --mock --trajectory circle.csv --on-end hold
    python examples/tracker.py --csv poses.csv          # t_s,x_mm,y_mm[,z_mm][,ax,ay,az], played in time
    python examples/tracker.py --plant wrong.yaml       # simulated: the daemon's actuators move *this* robot

With `feedback` in the daemon's robot file targets move until the measured tip is at its target; without,
measurements are recorded and shown. Replace `poses` by a loop over your own tracker.
"""

import argparse
import csv
import time
from collections.abc import Iterator
from pathlib import Path

from contid.client import Client
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import build_model
from contid.robot_file.load import load_robot_file

Numbers = list[float]


def recorded(path: Path) -> Iterator[tuple[float, Numbers, Numbers | None]]:
    """Rows of a table: time of capture (time.monotonic), position [mm], direction."""
    with path.open(newline="") as file:
        rows = [{name: float(cell) for name, cell in row.items()} for row in csv.DictReader(file)]
    start_s = time.monotonic() - rows[0]["t_s"]
    for row in rows:
        captured_s = start_s + row["t_s"]
        time.sleep(max(captured_s - time.monotonic(), 0.0))
        tip_mm = [row[name] for name in ("x_mm", "y_mm", "z_mm") if name in row]
        yield captured_s, tip_mm, [row[name] for name in ("ax", "ay", "az") if name in row] or None


def simulated(
    client: Client, name: str, path: Path, rate_hz: float
) -> Iterator[tuple[float, Numbers, Numbers | None]]:
    """Where the tip of another robot file would be with the measured actuation of the daemon's robot."""
    plant = load_robot_file(path).file.robots[name]
    model, frame = build_model(plant), BaseFrame.of(plant.base)
    for seen in client.telemetry(rate_hz, robots=name, fields=["measured"]):
        measured = seen["robots"][name]["measured"]
        if measured is not None:
            actuation = [value / plant.quantity.per_si for value in measured]
            pose = model.forward(tuple(actuation[: len(plant.axis_names)]))
            tip_mm = [1e3 * value for value in frame.point_in_world(pose.tip_m)]
            yield seen["t_s"], tip_mm, list(frame.vector_in_world(pose.direction))


def main() -> None:
    """Measure until interrupted, or until the table ends."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--csv", type=Path, help="measured poses")
    source.add_argument("--plant", type=Path, help="robot file of the plant that is simulated")
    parser.add_argument("--robot", help="whose tip; needed when the daemon has several")
    parser.add_argument("--rate", type=float, default=100.0, help="Hz, with --plant")
    parser.add_argument("--socket", help="of the daemon; else the only one that runs")
    asked = parser.parse_args()
    with Client(asked.socket, name="tracker") as client:
        name = asked.robot or next(iter(client.describe()["robots"]))
        poses = recorded(asked.csv) if asked.csv else simulated(client, name, asked.plant, asked.rate)
        for number, (captured_s, tip_mm, direction) in enumerate(poses):
            response = client.measure(tip_mm, direction=direction, robot=name, time_s=captured_s)
            if number == 0:
                print(f"{name}: measured; feedback is {'on' if response['feedback'] else 'off'}", flush=True)


if __name__ == "__main__":
    main()
