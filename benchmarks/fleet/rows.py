"""Rows per second of `Client.stream` by network, over a link with latency.

    python -m benchmarks.fleet.rows [--rows 200] [--round-trip-ms 0 50 100]

A daemon on simulated devices, its bridge at a TCP port, and a relay that delays every byte. Live rows are
targets at once; timed rows are sent, checked and released without being played.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

from benchmarks.on_sigterm import leave_on_sigterm
from contid.client import Client
from contid_fleet.fleet_address import FleetAddress
from contid_fleet.operator import FleetOperator
from tests.support.daemons import FAR, armed, daemon
from tests.support.fleets import BridgeProcess, bridge
from tests.support.ports import free_port
from tests.support.relay import Relay

#: Timed rows are this many times as many: they go in blocks.
TIMED: int = 50


def rates(robot: Client, rows: int) -> tuple[float, float]:
    """Live and timed rows per second."""
    x, y = FAR["x_mm"], FAR["y_mm"]
    robot.acquire(5.0)
    robot.move(FAR)
    begin_s = time.perf_counter()
    refused = robot.stream(["x_mm", "y_mm"], [(x, y + 0.001 * n) for n in range(rows)], wait=False)
    live = rows / (time.perf_counter() - begin_s)
    assert not refused, refused
    begin_s = time.perf_counter()
    robot.load(["t_s", "x_mm", "y_mm"], [(0.005 * n, x, y) for n in range(TIMED * rows)])
    return live, TIMED * rows / (time.perf_counter() - begin_s)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print one line per latency."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=200)
    parser.add_argument("--round-trip-ms", type=float, nargs="+", default=[0.0, 50.0, 100.0])
    given = parser.parse_args(arguments)
    port = free_port()
    with (
        daemon() as node,
        bridge({"hand1": node.socket}, endpoint=f"tcp/127.0.0.1:{port}") as served,
        node.client() as local,
    ):
        armed(local)
        local.release()
        for round_trip_ms in given.round_trip_ms:
            with Relay(port, 0.5e-3 * round_trip_ms) as relay:
                far = BridgeProcess(served.process, served.folder, f"tcp/127.0.0.1:{relay.port}")
                with (
                    FleetOperator(far.operator()) as operator,
                    Client(FleetAddress(operator, "hand1")) as robot,
                ):
                    live, timed = rates(robot, given.rows)
            print(f"round trip {round_trip_ms:g} ms: {live:.0f} live rows/s, {timed:.0f} timed rows/s")


if __name__ == "__main__":
    leave_on_sigterm()
    main()
