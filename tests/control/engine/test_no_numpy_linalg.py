"""No tick of a shipped robot calls NumPy's linear algebra: on paths, streams and jumps, in HOLD and stops."""

from __future__ import annotations

import dataclasses
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contid.control.engine.cycle import OnEnd
from contid.control.engine.messages import EndOfRows, Goto, Hold, Resume, Stop
from contid.control.engine.virtual import VirtualProcess
from contid.control.tick.supervisor import Mode
from contid.robot_file.load import load_robot_file, with_mock
from contid.targets import Target, vec3
from tests.control.engine.streamed import Run
from tests.golden.make import CONFIGS, RATE_HZ, names, trajectory
from tests.support.robot_configs import one_of_each_family


@dataclasses.dataclass
class Watch:
    """Where functions of ``numpy.linalg`` were called while it is on."""

    on: bool = False
    found: set[str] = dataclasses.field(default_factory=set)

    def watched(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **options: Any) -> Any:
            if self.on:
                place = next(
                    each for each in traceback.extract_stack()[-2::-1] if "numpy" not in each.filename
                )
                self.found.add(f"{name}: {Path(place.filename).name}:{place.lineno}")
            return function(*args, **options)

        return call


@pytest.fixture
def watch(monkeypatch: pytest.MonkeyPatch) -> Iterator[Watch]:
    watch = Watch()
    for name in np.linalg.__all__:
        function = getattr(np.linalg, name)
        if callable(function) and not isinstance(function, type):
            monkeypatch.setattr(np.linalg, name, watch.watched(name, function))
    yield watch
    watch.on = False


class Silent:
    """A sink that keeps nothing."""

    def write(self, values: list[float]) -> None:
        """See `contid.control.engine.cycle.Sink`."""

    def event(self, event: object) -> None:
        """See `contid.control.engine.cycle.Sink`."""


@pytest.mark.parametrize("name", one_of_each_family(names()))
def test_a_timed_path(name: str, watch: Watch) -> None:
    loaded = with_mock(load_robot_file(CONFIGS / f"{name}.yaml"))
    path = trajectory(loaded, RATE_HZ)
    process = VirtualProcess(loaded, RATE_HZ, Silent(), trajectory=path, on_end=OnEnd.HOLD, attended=True)
    engine = process.engine
    engine.arm()
    watch.on = True
    for verb in (None, Hold(), Resume(), Stop()):
        if verb is not None:
            engine.obey(verb, process.tick)
        for _ in range(80):
            process.begin()
            process.turn()
    assert engine.robots.states[0].mode is not Mode.FAULT
    assert not watch.found


@pytest.mark.parametrize(
    "name", one_of_each_family(name for name in names() if name not in ("chain", "hand"))
)
def test_a_stream_with_jumps_and_stops(name: str, watch: Watch) -> None:
    run = Run(name)
    loaded = with_mock(load_robot_file(CONFIGS / f"{name}.yaml"))
    columns = trajectory(loaded, RATE_HZ).rows[:, -loaded.driven[run.config.name].dimension :]
    tips = [run.config.frame.point_in_base(vec3((*row.tolist(), 0.0)[:3])) for row in columns]
    watch.on = True
    run.at_rest_on(tips[0])
    for tip in tips[1:]:
        for _ in range(3):  # a jump in motion
            run.row(tip)
            run.tick()
        for _ in range(15):
            run.tick()
    run.engine.obey(EndOfRows(), run.process.tick)
    for order in (
        Hold(),
        Goto(run.config.name, Target(tip_m=run.config.frame.point_in_world(tips[0]))),
        Stop(),
    ):
        run.engine.obey(order, run.process.tick)
        for _ in range(20):
            run.tick()
    assert run.mode is not Mode.FAULT
    assert not watch.found
