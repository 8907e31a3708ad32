"""The cases of `tests.campaign.clients.failing_devices` in virtual time, in this process.

``python -m tests.campaign.clients.virtual_time [--seeds N] [--seed N]``; a second of a processor each. The
server counts in virtual time too, and its checks are done where they are asked for: a seed is the same run on
every machine.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import logging
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import yaml

from contid.control.engine.events import RunEvent
from contid.control.engine.messages import Finish, Message, Play
from contid.control.engine.tick_layout import TickRecord
from contid.control.engine.virtual import VirtualProcess
from contid.control.engine.wiring import build_robot_configs, record_layout
from contid.control.tick.config import MOTION_RULES
from contid.control.tick.preflight.rows import Unreachable
from contid.remote.protocol.socket_path import Endpoint
from contid.remote.server.server import SocketServer
from contid.robot_file.load import LoadedFile, parse_robot_file
from contid.session.format.entries import Entry
from contid.trajectory.timed import Trajectory
from tests.campaign.clients.failing_devices import RATE_HZ, Case, Crowd, drawn
from tests.campaign.clients.seen import Seen
from tests.campaign.clients.seen_clients import checks

#: Virtual seconds for which clients give orders, and until the run has ended after them.
BUSY_S = 5.0
END_S = 6.0


class FailingRun:
    """A run in virtual time whose devices fail, as a server sees it; also its own recording."""

    rate_hz = float(RATE_HZ)
    unreachable = Unreachable.REFUSE
    input_active = False
    waiting = ""
    motion_rules = MOTION_RULES
    path = Path("virtual")

    def __init__(self, loaded: LoadedFile) -> None:
        self.loaded = loaded
        self.layout = record_layout(loaded, self.rate_hz)
        self.device_units = {
            axis: "rad" if axis.startswith("f") else "pa"
            for config in build_robot_configs(loaded, self.rate_hz) for axis in config.axes
        }  # fmt: skip
        self._written: list[Entry] = []
        self._inbox: list[Message] = []
        self._crosses_to = 0
        self._events: list[RunEvent] = []
        self._newest: TickRecord | None = None
        self._records: dict[int, TickRecord] = {}
        self._trajectories: list[Trajectory] = []
        self.listener: Callable[[RunEvent], None] = lambda event: None
        self.process = VirtualProcess(loaded, self.rate_hz, self, attended=True)
        self.process.engine.arm()

    # -- a sink ------------------------------------------------------------------------------------------

    def write(self, values: list[float]) -> None:
        self._written.append(Entry(0, values=[*values]))
        self._newest = self.layout.decode(tuple(values))
        self._records[self._newest.tick] = self._newest

    def event(self, event: RunEvent) -> None:
        self._written.append(Entry(0, event=event))
        self._events.append(event)

    # -- a recording -------------------------------------------------------------------------------------

    def entries(self) -> Iterator[Entry]:
        yield from self._written

    def robot_file(self) -> LoadedFile:
        return self.loaded

    @property
    def robots(self) -> dict[str, Any]:
        return {robot.name: robot for robot in self.layout.robots}

    def option(self, name: str) -> str:
        return {"attended": "true"}.get(name, "")

    def trajectory(self, loaded: LoadedFile, played: int = 0) -> Trajectory | None:
        return self._trajectories[played - 1] if played else None

    # -- a run -------------------------------------------------------------------------------------------

    def turn(self) -> None:
        """One tick, after the orders that were sent."""
        self.process.begin()
        inbox: list[Message] = []
        if self.process.tick >= self._crosses_to:
            inbox, self._inbox = self._inbox, []
        for message in inbox:
            self.process.engine.obey(message, self.process.tick)
        self.process.turn()
        events, self._events = self._events, []
        for event in events:
            self.listener(event)

    def send(self, message: Message) -> None:
        self._inbox.append(message)
        if isinstance(message, Play):
            self._trajectories.append(message.trajectory)
            self._crosses_to = self.process.tick + 20

    def newest(self) -> TickRecord | None:
        return self._newest

    def record_of(self, tick: int) -> TickRecord | None:
        return self._records.get(tick)

    def lateness(self, ticks: int) -> list[float]:
        return []

    def costs(self) -> list[float]:
        return [0.0] * len(self.loaded.driven)

    def refresh(self) -> None:
        """Events come with the ticks."""

    def listen(self, listener: Callable[[RunEvent], None]) -> None:
        self.listener = listener

    def interrupt(self) -> None:
        raise AssertionError("no client ends the run")

    def detach_input(self) -> None:
        raise AssertionError("there is no input")

    def note(self, event: object) -> None:
        raise AssertionError("no client writes a note")


def played(case: Case, path: Path) -> FailingRun:
    """Let the clients of a case give orders, then finish the run."""
    run = FailingRun(parse_robot_file(case.text, "adv.yaml"))

    async def at_once(check: Callable[..., Any], *arguments: Any) -> Any:
        return check(*arguments)

    with patch.object(time, "monotonic", run.process.clock.now), patch.object(asyncio, "to_thread", at_once):
        asyncio.run(_play(case, path, run))
    return run


async def _play(case: Case, path: Path, run: FailingRun) -> None:
    steps = itertools.count()
    case.now = lambda: run.process.clock.now() + 1e-9 * next(steps)

    async def sleep(seconds: float) -> None:
        end_s = run.process.clock.now() + seconds
        while run.process.clock.now() < end_s:
            await asyncio.sleep(0)

    case.sleep = sleep

    async def ticks() -> None:
        while True:
            run.turn()
            for _ in range(12):  # turns of the loop in a tick
                await asyncio.sleep(0)

    tasks = [asyncio.create_task(SocketServer(Endpoint(path)).serve(run))]
    for _ in range(60):
        run.turn()
        await asyncio.sleep(0)
    while not path.exists():
        await asyncio.sleep(0)
    tasks.append(asyncio.create_task(ticks()))
    crowd = asyncio.create_task(Crowd(case, path, list(run.loaded.driven), BUSY_S).go())
    done, _ = await asyncio.wait([crowd, *tasks], return_when=asyncio.FIRST_COMPLETED)
    for task in done:
        task.result()
    for task in tasks:
        task.cancel()
    await asyncio.wait(tasks)
    run.send(Finish())
    end_s = run.process.clock.now() + END_S
    while not run.process.engine.finished and run.process.clock.now() < end_s:
        run.turn()
    if not run.process.engine.finished:
        case.spoiled.append("the run did not end")


def found_in(seed: int) -> tuple[Case, list[str]]:
    """A case in virtual time, and what was wrong."""
    with tempfile.TemporaryDirectory(prefix="adv-") as name:
        folder = Path(name)
        case = drawn(seed, folder)
        case.input = False
        raw = yaml.safe_load(case.text)
        for bus in raw["buses"].values():  # they would delay all robots in virtual time
            bus["faults"] = [each for each in bus["faults"] if each["kind"] != "late"]
        case.text = yaml.safe_dump(raw, sort_keys=False, default_flow_style=None)
        run = played(case, folder / "s")
        seen = Seen(case, run)  # type: ignore[arg-type]
        found = [*case.spoiled, *checks(seen)]
        run.process.close()
    return case, found


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.campaign.clients.virtual_time", description=__doc__
    )
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-v", action="store_true")
    asked = parser.parse_args()
    logging.disable(logging.CRITICAL)
    wrong = orders = 0
    for seed in range(asked.seed, asked.seed + asked.seeds):
        began_s = time.process_time()
        case, found = found_in(seed)
        orders += len(case.orders)
        wrong += bool(found)
        if seed % 20 == 0:
            print(f"seed {seed}: {orders} orders so far, {wrong} with violations", flush=True)
        if found or asked.v:
            seconds = time.process_time() - began_s
            print(f"seed {seed}: {len(case.orders)} orders, {len(found)} wrong, {seconds:.1f} s", flush=True)
            for each in found[:10]:
                print("  ", each[:700])
        if asked.v:
            for order in case.orders:
                print("    ", order, order.result)
    print(f"{asked.seeds} seeds, {orders} orders, {wrong} with violations")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
