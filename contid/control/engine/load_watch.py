"""The observers of all robots that sense the force on their tips, and their estimates in the world frame."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from contid.control.engine.exchange import Exchange
from contid.control.engine.robots import Robots
from contid.control.tick.config import RobotConfig
from contid.control.tick.load_sensing.identified_arm import Numbers
from contid.control.tick.load_sensing.load_feed import CountedLoad, FedLoad, certain_share, fed, loaded
from contid.control.tick.load_sensing.load_observer import LoadFound, LoadObserver
from contid.control.tick.play import led
from contid.control.tick.tip_feedback import Measurement
from contid.targets import ZERO3, Actuation, Target, Vec3, vec3

#: An estimate without newer measurements is not shown any longer.
SHOWN_S = 1.0


class LoadWatch:
    """Estimates by robot.

    Attributes:
        observers: by the index of their robot.
        in_world: force and standard deviation of its components by name [N].
    """

    def __init__(self, robots: Robots, exchange: Exchange) -> None:
        self._robots = robots
        self._exchange = exchange
        self.observers = {
            index: LoadObserver(config.sensing, config.period_s)
            for index, config in enumerate(robots.configs)
            if config.sensing is not None
        }
        self.in_world: dict[str, tuple[Vec3, Vec3]] = {}
        self._fed = {
            config.name: FedLoad()
            for config in robots.configs
            if config.sensing is not None and config.sensing.load == "estimated"
        }
        self._counts: dict[str, CountedLoad] = {}
        self._shown: dict[int, LoadFound] = {}

    def tick(self, now_s: float, measured: Mapping[str, Measurement]) -> None:
        """One tick of every observer, before the ticks of the robots."""
        for index, observer in self.observers.items():
            config, state = self._robots.configs[index], self._robots.states[index]
            reported = _in_bar(config, config.measured_actuation(self._exchange.samples_of(config)))
            commands = _in_bar(config, led(state.command, state.lead.added))
            observer.tick(now_s, reported, commands, measured.get(config.name))
            found = observer.found
            if found is None or now_s - found.time_s > SHOWN_S:
                self.in_world.pop(config.name, None)
                self._shown.pop(index, None)
            elif self._shown.get(index) is not found:
                self._shown[index] = found
                self.in_world[config.name] = _in_world(config, found)
                if found.held:
                    x, y, z = self.in_world[config.name][0]
                    share = certain_share(found.force_in_base, found.covariance)
                    force = (share * x, share * y, share * z)
                    if not found.settled:
                        # After a sudden change the first estimates may be far off; the solver keeps the last.
                        before = self._counts.get(config.name)
                        force = ZERO3 if before is None else before.force_n
                    self._counts[config.name] = CountedLoad(found.time_s, force, found.margin)

    def loaded(self, targets: Mapping[str, Target | None], now_s: float) -> Mapping[str, Target | None]:
        """The targets of this tick, with the estimated load where the solver is to have it."""
        if not self._fed:
            return targets
        out = dict(targets)
        for index, config in enumerate(self._robots.configs):
            if (before := self._fed.get(config.name)) is None:
                continue
            target = targets.get(config.name) or self._robots.states[index].goto
            known_n = ZERO3 if target is None else target.load_n
            after = fed(before, now_s, config.period_s, self._counts.get(config.name), known_n)
            self._fed[config.name] = after
            if (given := out.get(config.name)) is not None:
                out[config.name] = loaded(after, given)
        return out

    def loaded_goto(self, robot: str, target: Target) -> Target:
        """A single target with the load of this moment."""
        fed_load = self._fed.get(robot)
        return target if fed_load is None else loaded(fed_load, target)


def _in_bar(config: RobotConfig, actuation: Actuation | None) -> Numbers | None:
    """The pressures of the model's own axes [bar], None without."""
    own = len(config.axes) - config.extra_axes
    return tuple([value * 1e-5 for value in actuation[:own]]) if actuation else None


def _in_world(config: RobotConfig, found: LoadFound) -> tuple[Vec3, Vec3]:
    rotation = np.array(config.frame.rotation).reshape(3, 3)
    spread = rotation @ np.array(found.covariance).reshape(3, 3) @ rotation.T
    return config.frame.vector_in_world(found.force_in_base), vec3(np.sqrt(np.diag(spread)).tolist())
