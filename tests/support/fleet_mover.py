"""Moves a node of a fleet with live rows until it is killed; SIGUSR1 hangs it. Arguments: FILE NODE LEASE."""

from __future__ import annotations

import math
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from contid.client import Client
from contid_fleet.fleet_address import FleetAddress
from contid_fleet.fleet_file import load_operator_file
from contid_fleet.operator import FleetOperator

PERIOD_S = 0.02


def rows() -> Iterator[list[float]]:
    begin_s = time.monotonic()
    for number in range(10**6):
        if number == 25:
            print("moving", flush=True)
        yield [15.0 * math.sin(2.0 * (time.monotonic() - begin_s)), 85.0]
        time.sleep(PERIOD_S)


def hang(*_: object) -> None:
    """The program hangs, and the threads of Zenoh do not."""
    time.sleep(60.0)


def main() -> None:
    signal.signal(signal.SIGUSR1, hang)
    path, node, lease_s = sys.argv[1:]
    with FleetOperator(load_operator_file(Path(path))) as operator:
        client = Client(FleetAddress(operator, node))
        client.acquire(float(lease_s))
        client.stream(["x_mm", "y_mm"], rows())


if __name__ == "__main__":
    main()
