"""The ports of the models of a robot file: those that the ticks ask, and those that are asked beside them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Final

from contid.control.engine.tick_costs import TickCosts
from contid.control.process.isolation.body import with_isolated_models
from contid.control.process.isolation.model_port import ModelPort
from contid.control.process.tick_alarm import LONGEST_S
from contid.kinematics.isolated_robot import IsolatedRobot
from contid.robot_file.load import LoadedFile

#: Share of a period for one question; the rest is for the robots beside.
SHARE: Final = 0.5


def model_ports(loaded: LoadedFile) -> list[ModelPort]:
    """A port of every isolated model of a file; forks, so before threads and real-time priority."""
    robots = loaded.file.robots
    return [ModelPort(name, robot) for name, robot in robots.items() if isinstance(robot, IsolatedRobot)]


def begin_ticks(models: Sequence[ModelPort], costs: TickCosts, rate_hz: float) -> None:
    """Bound the answers of all models from the first tick on.

    A robot alone has no robot beside it that could be late, and the time of any tick.
    """
    alone = len(costs.robots_s) == 1
    for model in models:
        model.begin_ticks(costs, LONGEST_S if alone else SHARE / rate_hz)


@contextmanager
def models_beside(loaded: LoadedFile, longest_s: float | None = None) -> Iterator[LoadedFile]:
    """The robot file with every model of others in a process of its own, for what asks them beside a tick.

    Args:
        loaded: the robot file.
        longest_s: longest answer of a model once it is built; None for that of building.

    Raises:
        ModelLostError: one cannot be built.
    """
    isolated = with_isolated_models(loaded)
    with ExitStack() as stack:
        ports = model_ports(isolated)
        for port in ports:
            stack.callback(port.close)
        for port in ports:
            port.finish_building()
            if longest_s is not None:
                port.longest_s = longest_s
        yield isolated
