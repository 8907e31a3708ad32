"""What the soak runs on: the laboratory on emulated wires, the daemon with its viewers, the devices' process.

The hand is on emulated servos, tri-rack and pneumatic arm on three boards that run the sketch itself, each
behind a pseudo terminal of its own. ``python -m benchmarks.soak_lab devices FOLDER`` emulates them (a line
appended to ``FOLDER/BUS.switch`` operates a fault switch of one bus); ``daemon FOLDER SECONDS`` is the
daemon as `contid run` starts it, recording, with one viewer after the other, each killed after so long.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
import threading
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Final

import yaml

from benchmarks.lab import lab_text
from contid.control.daemon.interfaces import RunControl
from contid.control.engine.cycle import Sink
from contid.control.engine.messages import Message
from contid.control.engine.wiring import wired_buses
from contid.control.process.pipe import RunSetup
from contid.errors import ContidError
from contid.robot_file.load import load_robot_file
from contid_emulate.offered import emulated
from contid_view.observer import ViewerObserver
from contid_view.view_target import Kind, ViewTarget

RATE_HZ: Final = 200.0
#: How long each viewer draws before it is killed; it begins to draw after a second or two.
VIEWER_S: Final = 20.0
#: What pulls the plug of a bus and puts it back, by driver.
UNPLUG: Final = {"dynamixel": ("unplug", "replug"), "due": ("unplug", "plug")}
#: Emulated devices share two cores with everything else here: limits, so that a fault is a pulled cable.
TOLERANCE_TICKS: Final = 40
BUS_TIMEOUTS: Final = {
    "dynamixel": {"usb_latency_ms": 15, "watchdog_ms": 400},
    "due": {"latency_ms": 15, "watchdog_ms": 400},
}
#: Of SCHED_FIFO, below the control process, as `contid emulate` has it.
_PRIORITY: Final = 40


def robot_file(folder: Path) -> str:
    """The laboratory on wires, one pseudo terminal per bus in this folder."""
    raw = yaml.safe_load(lab_text(RATE_HZ, ".emulated"))
    for name, bus in raw["buses"].items():
        bus |= {"port": f"{folder}/{name}.tty", "tolerance_ticks": TOLERANCE_TICKS} | BUS_TIMEOUTS[
            bus["driver"]
        ]
    for robot in raw["robots"].values():
        robot.pop("placeholder", None)
    return yaml.safe_dump(raw, sort_keys=False, default_flow_style=None)


class Viewers:
    """One viewer after another, each killed while it draws: an observer and an idle command source."""

    def __init__(self, folder: Path, seconds: float = VIEWER_S) -> None:
        self._path = folder / "view.rrd"
        self._seconds = seconds
        self._run: tuple[RunSetup, int] | None = None
        self.killed = 0

    def attach(self, setup: RunSetup, pid: int) -> None:
        """Keep the arguments of a viewer."""
        self._run = setup, pid

    def follow(self, setup: RunSetup) -> Sink:
        """Not in virtual time."""
        raise ContidError("viewers are killed in real time only")

    def before_order(self, message: Message) -> None:
        """Nothing to draw."""

    def detach(self) -> Sequence[str]:
        """The last viewer has ended already."""
        return ()

    async def serve(self, orders: RunControl) -> None:
        """See `contid.control.daemon.interfaces.CommandSource`."""
        while self._run is None:  # sources of commands begin before the input has come
            await asyncio.sleep(0.1)
        while True:
            self._path.unlink(missing_ok=True)
            viewing = ViewerObserver(ViewTarget(Kind.FILE, self._path))
            viewing.attach(*self._run)
            try:
                await asyncio.sleep(self._seconds)
            finally:
                assert viewing.pid is not None
                os.kill(viewing.pid, signal.SIGKILL)
                viewing.detach()
                self.killed += 1


def daemon(folder: Path, viewer_s: float) -> int:
    """The process that is watched: the daemon as `contid run` starts it."""
    from contid.control.daemon.run import run
    from contid.control.daemon.run_request import RunRequest
    from contid.control.engine.cycle import OnEnd
    from contid.control.tick.preflight.rows import Unreachable
    from contid.remote.protocol.socket_path import Endpoint
    from contid.remote.server.server import SocketServer
    from contid.session.recording_observer import RecordingObserver

    endpoint = Endpoint(folder / "lab.sock", default=False)
    viewers = Viewers(folder, viewer_s)
    request = RunRequest(
        robot_file=str(folder / "lab.yaml"),
        on_end=OnEnd.HOLD,
        unreachable=Unreachable.NEAREST,
        commands=[SocketServer(endpoint), viewers],
        observers=[RecordingObserver(folder / "lab.mcap", {}), viewers],
    )
    try:
        report = run(request)
    finally:
        endpoint.close()
    print(json.dumps({**report.as_dict(), "viewers_killed": viewers.killed}))
    return report.exit_code


def devices(folder: Path) -> int:
    """Every device of the laboratory, until SIGINT or SIGTERM."""
    ends = {signal.SIGINT, signal.SIGTERM}
    signal.pthread_sigmask(signal.SIG_BLOCK, ends)
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    with ExitStack() as stack:
        for bus in wired_buses(load_robot_file(folder / "lab.yaml")):
            switches = folder / f"{bus.wiring.name}.switch"
            switches.touch()
            stack.enter_context(emulated(bus, switches))
        print("ready", flush=True)
        signal.sigwait(ends)
    assert threading.active_count() == 1
    return 0


def main() -> int:
    """One of the two processes."""
    what, folder = sys.argv[1], Path(sys.argv[2])
    return devices(folder) if what == "devices" else daemon(folder, float(sys.argv[3]))


if __name__ == "__main__":
    sys.exit(main())
