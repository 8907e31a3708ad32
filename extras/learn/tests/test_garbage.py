"""A policy of garbage through the path of `contid run --policy`, in virtual time: no limit is exceeded.

ONNX file, `PolicyLoop`, servo loop, client, socket, checks of rows, engine: all but the processes and the
thread of the network are those of a run. `CONTID_GARBAGE` gives the steps of the campaign, `CONTID_SEED` its
numbers; ``test_run_policy`` has a run in real time.
"""

from __future__ import annotations

import math
import os
import time
from collections import Counter
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from contid import Robot
from contid.client import RemoteError
from contid.control.tick.supervisor import Mode
from contid.errors import ContidError
from contid_learn import Policy, PolicyAbout, write_policy
from contid_learn.policy_loop import PolicyLoop
from contid_learn.views import RobotView, views_of
from contid_library.async_client import AsyncClient
from tests.support.virtual.commands import Commands
from tests.support.virtual.daemon import VirtualDaemon, in_virtual_time, serving

RATE_HZ: Final = 100.0
STEPS: Final = int(os.environ.get("CONTID_GARBAGE", "8000"))
SEED: Final = int(os.environ.get("CONTID_SEED", "1"))
#: An answer that does not come in time.
LATE: Final = object()


class GarbageSession:
    """What `onnxruntime` gives of a broken network: garbage of the right type, and of every other one."""

    def __init__(self, axes: int, seed: int, wrong_share: float) -> None:
        self._axes, self._wrong_share = axes, wrong_share
        self._rng = np.random.default_rng(seed)
        self.asked: Counter[str] = Counter()

    def run(self, _outputs: Any, _inputs: Any) -> list[Any]:
        if self._rng.random() < self._wrong_share:
            return [self._wrong_type()]
        kinds = ("late", "not finite", "partly not finite", "huge", "bang", "bang", "noise", "noise")
        kind = str(self._rng.choice(kinds))
        self.asked[kind] += 1
        rng, axes = self._rng, self._axes
        match kind:
            case "late":
                return [LATE]
            case "not finite":
                return [np.full(axes, rng.choice([math.nan, math.inf, -math.inf]), np.float32)]
            case "partly not finite":
                return [np.where(rng.random(axes) < 0.5, math.nan, 1.0)]
            case "huge":
                return [rng.choice([-1e300, 1e300, -1e30, 1e30], axes)]
            case "bang":
                return [rng.choice([-1.0, 1.0], axes)]
        return [rng.normal(0.0, 10.0 ** rng.integers(-3, 4), (1, axes))]

    def _wrong_type(self) -> Any:
        axes = self._axes
        wrong: dict[str, Any] = {
            "None": None, "text": "left", "texts": ["1", "x"], "a map": {0: 1.0}, "maps": [{0: 1.0}] * axes,
            "ragged": [[1.0], [1.0, 2.0]], "too many": np.ones(axes + 1), "too few": np.ones(axes - 1),
            "nothing": np.zeros(0), "an object": object(), "a scalar": 1.0, "too large": [10**400] * axes,
            "raises": RuntimeError("the graph is broken"), "raises without words": ValueError(),
        }  # fmt: skip
        kind = str(self._rng.choice([*wrong]))
        self.asked[kind] += 1
        if isinstance(wrong[kind], Exception):
            raise wrong[kind]
        return wrong[kind]


class GarbagePolicy(Policy):
    """A policy of a file whose network has broken since."""

    def __init__(self, path: Path, session: GarbageSession) -> None:
        super().__init__(path)
        self._session = session

    def ask(self, observed: Any, _timeout_s: float) -> Any:
        """As `contid_learn.policy_loop.Inference`; None when the answer is late."""
        before = self._session.asked["late"]
        try:
            return self(observed)
        except ContidError:
            if self._session.asked["late"] > before:
                return None
            raise

    def close(self) -> None: ...


def driven(
    name: str, folder: Path, steps: int, seed: int, wrong_share: float = 0.01
) -> tuple[Commands, Counter[str], dict[str, int]]:
    """Drive robots by garbage; a policy that ended is started again, as by a person who does not look."""
    views = views_of(Robot(name), RATE_HZ)
    axes = sum(len(view.columns) for view in views)
    about = PolicyAbout.of(views, RATE_HZ, "reach")
    write_policy(folder / "p.onnx", about, [(np.zeros((axes, about.width)), np.zeros(axes))])
    session = GarbageSession(axes, seed, wrong_share)
    policy = GarbagePolicy(folder / "p.onnx", session)
    faults: Counter[str] = Counter()

    def judge(robots: Any) -> None:
        commands.take(robots)
        faults.update(Mode(robot.mode).name for robot in robots if robot.mode == Mode.FAULT)

    run = VirtualDaemon(name, judge)
    commands = Commands(run.engine.robots.configs, run.rate_hz, beside_a_body=name == "hand")

    async def main() -> None:
        async with serving(run) as path, AsyncClient(path, name="policy") as client:
            while session.asked.total() < steps:
                await client.resume()
                loop = PolicyLoop(views, policy, _goals(views), 1.0 / RATE_HZ)
                loop.close()
                loop._inference = policy  # type: ignore[assignment]
                try:
                    await client.servo(RATE_HZ, loop)
                except (ContidError, RemoteError) as error:
                    ended[str(error).split(": ")[-1][:40]] += 1

    ended: Counter[str] = Counter()
    in_virtual_time(main)
    commands.compare()
    assert not faults, faults
    return commands, session.asked, dict(ended)


def _goals(views: tuple[RobotView, ...]) -> dict[str, Any]:
    return {view.name: view.reachable.tips[0] for view in views}


def test_garbage_of_every_type_exceeds_no_limit(tmp_path: Path) -> None:
    commands, asked, ended = driven("finger", tmp_path, 600, 1, wrong_share=0.04)
    assert len(asked) > 12, asked
    assert sum(ended.values()) > 5, ended
    assert {key: commands.exceeded[key] for key in ("position", "velocity", "acceleration")} == {
        "position": 0, "velocity": 0, "acceleration": 0
    }  # fmt: skip


@pytest.mark.campaign
@pytest.mark.timeout(14_400)
@pytest.mark.parametrize("name", ["finger", "catheter", "cbha", "hand"])
def test_much_garbage_of_every_type_exceeds_no_limit(tmp_path: Path, name: str) -> None:
    began_s = time.process_time()
    commands, asked, ended = driven(name, tmp_path, STEPS, SEED)
    used_s = time.process_time() - began_s
    print(
        f"{name}, seed {SEED}: {asked.total()} steps, {commands.ticks} ticks, {asked.total() / used_s:.0f} "
        f"steps per second of a processor; exceeded: {commands.exceeded}; {sum(ended.values())} ends: {ended}"
    )
    assert not any(commands.exceeded.values()), commands.exceeded
