"""Clients that give random orders in the same ticks to a real daemon whose simulated devices fail.

``python -m tests.campaign.clients.failing_devices [--seeds N] [--seed N]`` starts `contid run` on two fingers
and a pneumatic arm, with up to five faults of their devices, and lets four clients give orders for some
seconds; exit 1 on a violation. `tests.campaign.clients.seen_clients` has what must hold.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from contid.remote.protocol.socket_path import is_listening
from contid.robot_file.load import configs_folder
from tests.campaign.clients.seen_clients import checked
from tests.remote.orders.history import Order
from tests.support.fingers import circle_csv, fingers
from tests.support.waiting import until

CLIENTS = 4
#: The faults of a finger, and of a chamber.
SHAFT = ("silent", "stale", "overload", "stall", "lost", "late", "scaled", "jump", "play", "swapped", "slow")
CHAMBER = ("silent", "stale", "stall", "lost", "late", "leak", "jump", "scaled")
RATE_HZ = 200
#: Of targets: a finger reaches these.
TIPS = ((50.0, 75.0), (45.0, 75.0), (30.0, 85.0), (60.0, 70.0))
PRESSURES = (0.1, 0.2, 0.4)


@dataclass
class Case:
    """What one seed draws, and what was seen of it.

    Attributes:
        seed: of everything random.
        text: of the robot file.
        input: the run follows a trajectory of its own and ends with it.
        orders: of all clients, with monotonic times.
        closed: when clients left, by number.
        notices: of moves, by client and number of the move.
        code: exit code.
        report: closing report.
        stderr: what the daemon printed.
    """

    seed: int
    text: str
    input: bool
    orders: list[Order] = field(default_factory=list)
    closed: dict[int, float] = field(default_factory=dict)
    notices: list[tuple[int, dict[str, Any]]] = field(default_factory=list)
    code: int | None = None
    report: dict[str, Any] = field(default_factory=dict)
    stderr: str = ""
    folder: Path = Path()
    spoiled: list[str] = field(default_factory=list)
    now: Callable[[], float] = time.monotonic
    sleep: Callable[[float], Awaitable[None]] = asyncio.sleep


def drawn(seed: int, folder: Path) -> Case:
    """The case of a seed."""
    dice = random.Random(f"adversary:{seed}")
    how: dict[str, Any] = {
        "on_interrupt": dice.choice(("hold", "relax", "rest")),
        "on_fault": dice.choice(("hold", "relax", "hold")),
    }
    raw = yaml.safe_load(fingers(2, buses=2, **how, rate_hz=RATE_HZ))
    arm = yaml.safe_load((configs_folder() / "chambers3.yaml").read_text())["robots"]["arm"]
    for axis in arm["axes"]:
        arm["axes"][axis] = {"bus": "air", "device": "regulator", "ceiling_bar": 1.6}
    del arm["placeholder"], arm["down"]
    with_arm = dice.random() < 0.7
    if with_arm:
        raw["buses"]["air"] = {"driver": "sim", "tolerance_ticks": 3}
        raw["robots"]["p"] = arm
    if dice.random() < 0.3:  # a robot whose axes are on two buses
        raw["robots"]["f1"]["axes"]["right"]["bus"] = "bus0"
    watchdog_ms = dice.choice((200, 200, 1500, 5000))
    axes_of: dict[str, list[str]] = {name: [] for name in raw["buses"]}
    for name, robot in raw["robots"].items():
        for axis, given in robot["axes"].items():
            axes_of[given["bus"]].append(f"{name}.{axis}")
    for name, bus in raw["buses"].items():
        bus |= {"journal_file": str(folder / f"{name}.jsonl"), "watchdog_ms": watchdog_ms, "faults": []}
    for _ in range(dice.choice((0, 1, 1, 2, 3, 5))):
        bus = dice.choice(list(raw["buses"]))
        raw["buses"][bus]["faults"].append(_fault(dice, bus == "air", axes_of[bus]))
    is_input = dice.random() < 0.3
    return Case(seed, yaml.safe_dump(raw, sort_keys=False, default_flow_style=None), is_input, folder=folder)


def _fault(dice: random.Random, air: bool, axes: list[str]) -> dict[str, Any]:
    kind = dice.choice(CHAMBER if air else SHAFT)
    found: dict[str, Any] = {"at_s": round(dice.uniform(0.3, 4.0), 3), "kind": kind}
    if kind == "swapped" and len(axes) < 2:
        kind = found["kind"] = "stall"
    if kind not in ("lost", "late"):
        found["axis"] = dice.choice(axes)
    if dice.random() < 0.8:
        found["for_s"] = round(dice.choice((0.01, 0.05, 0.3, 1.0, 2.5)), 3)
    match kind:
        case "late":
            found["delay_ms"] = dice.choice((3.0, 8.0, 30.0, 150.0))
        case "scaled":
            found["share"] = dice.choice((0.0, 0.33, -1.0))
        case "leak":
            found["share"] = dice.choice((0.0, 0.5))
        case "slow":
            found["share"] = dice.choice((0.02, 0.1, 0.5))
        case "jump" | "play":
            found["by_bar" if air else "by_deg"] = 0.1 if air else 15.0
        case "swapped":
            found["other"] = dice.choice([each for each in axes if each != found["axis"]])
    return found


class Wire:
    """The connection of one client."""

    def __init__(self, case: Case, number: int) -> None:
        self.case, self.number, self.move = case, number, 0
        self._waiting: dict[int, tuple[Order, asyncio.Future[Order]]] = {}
        self._id = 0

    async def connect(self, path: Path) -> None:
        self._reader, self._writer = await asyncio.open_unix_connection(str(path))
        self._task = asyncio.create_task(self._read())

    def give(self, verb: str, **fields: Any) -> asyncio.Future[Order]:
        """Send an order; the future is done with its answer."""
        future: asyncio.Future[Order] = asyncio.get_running_loop().create_future()
        self._id += 1
        order = Order(self.number, verb, fields, self.case.now(), 0)  # type: ignore[arg-type]
        self.case.orders.append(order)
        self._waiting[self._id] = (order, future)
        with suppress(ConnectionError):
            self._writer.write(json.dumps({"id": self._id, "verb": verb, **fields}).encode() + b"\n")
        return future

    async def _read(self) -> None:
        with suppress(ConnectionError, asyncio.LimitOverrunError):
            while line := await self._reader.readline():
                answer = json.loads(line)
                if "ok" not in answer:
                    if answer.get("event") == "move":
                        self.case.notices.append((self.number, {**answer, "at_s": self.case.now()}))
                    continue
                if answer["id"] not in self._waiting:
                    self.case.spoiled.append(f"client {self.number}: answered twice or unasked: {answer}")
                    continue
                order, future = self._waiting.pop(answer["id"])
                order.answered, order.ok = self.case.now(), answer["ok"]
                order.code = answer.get("error", {}).get("code", "")
                order.result = answer.get("result", {}) or answer.get("error", {})
                if not future.done():
                    future.set_result(order)
        for _, future in self._waiting.values():
            future.cancel()

    async def close(self) -> None:
        """Leave, whatever is under way."""
        self._task.cancel()
        await asyncio.wait([self._task])
        self._writer.close()
        with suppress(ConnectionError):
            await self._writer.wait_closed()
        self.case.closed[self.number] = self.case.now()
        for _, future in self._waiting.values():
            future.cancel()


class Crowd:
    """The clients of a case."""

    def __init__(self, case: Case, path: Path, robots: list[str], busy: float) -> None:
        self.case, self.path, self.robots = case, path, robots
        self.dice = random.Random(f"crowd:{case.seed}")
        self.clients = 0
        self.volley = asyncio.Event()
        self.until_s = case.now() + busy

    async def go(self) -> None:
        """Let them give orders until the time is over."""
        pacer = asyncio.create_task(self._pace())
        await asyncio.gather(*(self._client() for _ in range(CLIENTS)))
        pacer.cancel()
        with suppress(asyncio.CancelledError):
            await pacer

    async def _pace(self) -> None:
        while True:
            await self.case.sleep(self.dice.choice((0.005, 0.02, 0.1, 0.3)))
            self.volley.set()
            self.volley.clear()

    async def _client(self) -> None:
        while self.case.now() < self.until_s:
            self.clients += 1
            wire = Wire(self.case, self.clients)
            try:
                await wire.connect(self.path)
            except OSError:
                return
            leaves = False
            tasks: set[asyncio.Task[None]] = set()
            try:
                while self.case.now() < self.until_s and not leaves:
                    await self.volley.wait()
                    if len(tasks) < 3:
                        task = asyncio.create_task(self._orders(wire))
                        tasks.add(task)
                        task.add_done_callback(tasks.discard)
                    leaves = self.dice.random() < 0.03
                end_s = self.case.now() + 4.0
                while not leaves and tasks and self.case.now() < end_s:
                    await self.case.sleep(0.02)
            finally:
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)
                await wire.close()

    def _target(self) -> dict[str, float]:
        dice = self.dice
        found: dict[str, float] = {}
        for robot in dice.sample(self.robots, dice.choice((1, 1, len(self.robots)))):
            if robot == "p":
                found |= {f"p.s1.p{k}_bar": dice.choice(PRESSURES) for k in (1, 2, 3)}
            else:
                x, y = dice.choice(TIPS)
                x = x if robot == "f0" else 100.0 - x
                found |= {f"{robot}.x_mm": x, f"{robot}.y_mm": y}
        return found

    def _who(self) -> dict[str, Any]:
        dice = self.dice
        if dice.random() < 0.5:
            return {}
        return {"robots": dice.sample(self.robots, dice.choice((1, 1, len(self.robots))))}

    async def _orders(self, wire: Wire) -> None:
        dice = self.dice
        kinds = ("stop", "stop", "resume", "clear", "move", "move", "move", "stream", "play", "lease",
                 "person", "person", "person", "recover", "grip", "both")  # fmt: skip
        match dice.choice(kinds):
            case "stop":
                await wire.give(dice.choice(("hold", "hold", "hold", "stop", "estop")), **self._who())
            case "resume":
                after = {"after_stop": True} if dice.random() < 0.4 else {}
                await wire.give("resume", **self._who(), **after)
            case "clear":
                await wire.give("clear_fault", **self._who())
            case "recover":
                await wire.give("recover", **self._who())
            case "grip":
                await wire.give("grip", share=dice.choice((0.3, 1.0)))
            case "both":
                wire.give(dice.choice(("estop", "stop", "hold")), **self._who())
                wire.give("resume", after_stop=True, **self._who())
                wire.give("clear_fault")
                await wire.give(dice.choice(("estop", "resume", "recover", "hold")), **self._who())
            case "move":
                await wire.give("move", target=self._target())
            case "stream":
                target = self._target()
                begun = await wire.give("move", columns=[*target])
                for _ in range(6 if begun.ok else 0):
                    rows = [[value + dice.uniform(0.0, 0.02) for value in target.values()]]
                    wire.give("rows", move=begun.result["move"], rows=rows)
                    await self.case.sleep(0.02)
                if begun.ok:
                    await wire.give("end", move=begun.result["move"])
            case "play":
                target = self._target()
                begun = await wire.give("move", columns=["t_s", *target])
                if begun.ok:
                    move, values = begun.result["move"], [*target.values()]
                    rows = [[0.1 * step, *(v * (1.0 + 0.003 * step) for v in values)] for step in range(5)]
                    await wire.give("rows", move=move, rows=rows)
                    await wire.give("end", move=move, hold_at_start=dice.random() < 0.2)
            case "lease":
                if dice.random() < 0.4:
                    await wire.give("release")
                else:
                    fields = {"takeover": dice.random() < 0.5, "unless_stopped": dice.random() < 0.3}
                    await wire.give("acquire", timeout_s=dice.choice((0.3, 60.0)), **fields)
            case "person":
                await wire.give("acquire", timeout_s=60.0, takeover=True)
                await wire.give("clear_fault")
                await wire.give("resume", after_stop=True)
                await self.case.sleep(dice.choice((0.0, 0.03, 0.2)))
                await wire.give("move", target=self._target())


@contextmanager
def _folder() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp(prefix="adv-"))  # short: the path of a socket has 107 bytes
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def run(case: Case, busy_s: float = 3.5) -> None:
    """Start the daemon of a case, let the clients have it, end it."""
    dice, folder = random.Random(f"run:{case.seed}"), case.folder
    (folder / "adv.yaml").write_text(case.text)
    raw = yaml.safe_load(case.text)
    robots = list(raw["robots"])
    arguments = ["--record", str(folder / "s.mcap"), "--socket", str(folder / "s"), "--json"]
    if case.input:
        (folder / "c.csv").write_text(circle_csv(2, period_s=2.5, rows=50))
        arguments += ["--trajectory", str(folder / "c.csv")]
    with (folder / "err").open("wb") as err, (folder / "out").open("wb") as out:
        process = subprocess.Popen(
            [sys.executable, "-m", "contid", "run", str(folder / "adv.yaml"), *arguments],
            stdin=subprocess.DEVNULL, stdout=out, stderr=err, cwd=folder,
        )  # fmt: skip
    try:
        path = folder / "s"
        until(lambda: is_listening(path) or process.poll() is not None, "the daemon listens")
        until(lambda: any(folder.glob("*.jsonl")) or process.poll() is not None, "the buses open")
        if process.poll() is None:
            asyncio.run(_busy(case, path, robots, busy_s))
        if case.input and dice.random() < 0.7:  # a client that took over has ended the input
            with suppress(subprocess.TimeoutExpired):
                process.wait(4.0)
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        case.code = process.wait(20)
    except subprocess.TimeoutExpired:
        case.spoiled.append("the daemon did not end")
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            time.sleep(2.0)
            process.kill()
        process.wait()
        case.stderr = (folder / "err").read_text(errors="replace")
        with suppress(ValueError):
            case.report = json.loads((folder / "out").read_text())


async def _busy(case: Case, path: Path, robots: list[str], busy_s: float) -> None:
    dice = random.Random(f"busy:{case.seed}")
    await asyncio.sleep(dice.choice((0.0, 0.05, 0.4, 1.0)))
    await Crowd(case, path, robots, busy_s).go()


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.campaign.clients.failing_devices", description=__doc__
    )
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for what violated cases leave")
    asked = parser.parse_args()
    wrong = orders = 0
    for seed in range(asked.seed, asked.seed + asked.seeds):
        with _folder() as folder:
            case = drawn(seed, folder)
            run(case)
            found = [*case.spoiled, *checked(case)]
            orders += len(case.orders)
            print(f"seed {seed}: exit {case.code}, {len(case.orders)} orders, {len(found)} wrong", flush=True)
            for each in found[:12]:
                print(f"  {each[:600]}")
            wrong += bool(found)
            if found and asked.keep is not None:
                shutil.copytree(folder, asked.keep / str(seed), dirs_exist_ok=True,
                                ignore=shutil.ignore_patterns("s"))  # fmt: skip
                lines = [f"{o.sent:.4f} {o}" for o in sorted(case.orders, key=lambda o: o.sent)]
                (asked.keep / str(seed) / "orders").write_text("\n".join(lines))
    print(f"{asked.seeds} seeds, {orders} orders, {wrong} with violations")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
