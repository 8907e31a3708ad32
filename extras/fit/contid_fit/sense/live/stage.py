"""The stage of a tick that estimates the force on the tip of an arm and looks for contacts of the tip."""

from __future__ import annotations

from typing import Final

import numpy as np

from contid.control.engine.cycle import Timing
from contid.control.engine.events.robots import ContactBegan
from contid.control.engine.stages import EngineParts, Targets, TickStage
from contid.control.tick.config import RobotConfig
from contid.control.tick.play import led
from contid.robot_file.base import ContactPolicy
from contid.robot_file.cosserat import Cosserat
from contid.targets import ZERO3, Actuation, Target, Vec3, vec3
from contid_fit.identified_arm import Numbers
from contid_fit.sense.live.load_feed import CountedLoad, FedLoad, certain_share, fed, loaded
from contid_fit.sense.live.load_observer import LoadFound, LoadObserver
from contid_fit.sense.live.tip_contact import TipContact, TipContactFound

#: An estimate is shown for this time after its newest measurement [s].
SHOWN_S: Final = 1.0


def build_load_sensing(index: int, parts: EngineParts) -> TickStage | None:
    """The stage of a robot with ``sense.load``; see `contid.control.engine.stages`."""
    sensing = parts.robots.configs[index].sensing
    return None if sensing is None else LoadSensingStage(index, sensing, parts)


class LoadSensingStage(TickStage):
    """The force on the tip of one arm.

    Args:
        index: index of its robot.
        sensing: its description, with a ``sense``.
        parts: parts of the engine.
    """

    def __init__(self, index: int, sensing: Cosserat, parts: EngineParts) -> None:
        self.robots = (index,)
        self._index = index
        self._parts = parts
        self._config = config = parts.robots.configs[index]
        self._observer = LoadObserver(sensing, config.period_s)
        swing = self._observer.swing
        self._tip = None if config.contact is None else TipContact(sensing, self._observer.arm, swing)
        # The load that is added to targets; None where the solver is not to have the estimate.
        self._fed = FedLoad() if sensing.load == "estimated" else None
        # The newest estimate that the added load follows, and the newest that is shown.
        self._counted: CountedLoad | None = None
        self._shown: LoadFound | None = None

    def before(self, targets: Targets, timing: Timing, now_s: float) -> Targets:
        """Before the ticks of the robots: the targets, changed or not.

        See `TickStage.before`: the target gets the estimated load where the solver is to have it.
        """
        self._estimate(now_s)
        if self._tip is not None:
            newest = self._parts.robots.measured.get(self._config.name)
            found = self._tip.tick(self._observer.trace, newest, self._observer.found)
            if found is not None:
                self._report_contact(found, timing.tick, now_s)
        if self._fed is None:
            return targets
        given = targets.get(self._config.name)
        target = given or self._parts.robots.states[self._index].goto
        known_n = ZERO3 if target is None else target.load_n
        self._fed = fed(self._fed, now_s, self._config.period_s, self._counted, known_n)
        return targets if given is None else {**targets, self._config.name: loaded(self._fed, given)}

    def goto(self, robot: str, target: Target) -> Target:
        """A single target that was ordered, changed or not.

        See `TickStage.goto`: with the load of this moment.
        """
        mine = robot == self._config.name
        return loaded(self._fed, target) if mine and self._fed is not None else target

    def _estimate(self, now_s: float) -> None:
        """One tick of the observer, and what of its estimate is shown and counts."""
        config, robots, observer = self._config, self._parts.robots, self._observer
        state = robots.states[self._index]
        reported = _in_bar(config, config.measured_actuation(self._parts.exchange.samples_of(config)))
        commands = _in_bar(config, led(state.command, state.lead.added))
        observer.tick(now_s, reported, commands, robots.measured.get(config.name))
        found = observer.found
        if found is None or now_s - found.time_s > SHOWN_S:
            robots.loads.pop(config.name, None)
            self._shown = None
        elif self._shown is not found:
            self._shown = found
            force_n, sigma_n = _in_world(config, found)
            robots.loads[config.name] = force_n, sigma_n
            if found.held:
                share, (x, y, z) = certain_share(found.force_in_base, found.covariance), force_n
                counted_n = (share * x, share * y, share * z)
                if not found.settled:
                    # After a sudden change the first estimates may be far off; the solver keeps the last.
                    counted_n = ZERO3 if self._counted is None else self._counted.force_n
                self._counted = CountedLoad(found.time_s, counted_n, found.margin)

    def _report_contact(self, found: TipContactFound, tick: int, now_s: float) -> None:
        """Write the event of a contact and let the robot react by its policy.

        Args:
            found: the contact.
            tick: number of this tick.
            now_s: of this tick, in the time of the robots.
        """
        config, react = self._config, self._parts.react
        assert config.contact is not None
        assert react is not None  # this robot looks for contacts
        direction = [round(part, 4) for part in config.frame.vector_in_world(found.direction_in_base)]
        self._parts.sink.event(
            ContactBegan(
                tick=tick,
                robot=config.name,
                time_s=found.time_s,
                direction=direction,
                force_n=found.force_n,
                confidence=found.confidence,
                policy=config.contact.value,
                message=_message(direction, found.force_n, config.contact),
            )
        )
        react(self._index, found.time_s, "contact of its tip", now_s)


def _in_bar(config: RobotConfig, actuation: Actuation | None) -> Numbers | None:
    """The pressures of the model's own axes [bar] from an actuation [Pa]; None for None or an empty one."""
    own = len(config.axes) - config.extra_axes
    return tuple([value * 1e-5 for value in actuation[:own]]) if actuation else None


def _in_world(config: RobotConfig, found: LoadFound) -> tuple[Vec3, Vec3]:
    """The force of an estimate and the standard deviations of its components, both in the world frame [N]."""
    rotation = np.array(config.frame.rotation).reshape(3, 3)
    spread = rotation @ np.array(found.covariance).reshape(3, 3) @ rotation.T
    return config.frame.vector_in_world(found.force_in_base), vec3(np.sqrt(np.diag(spread)).tolist())


def _message(direction: list[float], force_n: float, policy: ContactPolicy) -> str:
    """The message of a contact; ``direction`` is a unit vector in the world frame."""
    along = ", ".join(f"{part:.2f}" for part in direction)
    return f"contact: force {1e3 * force_n:.1f} mN along ({along}); policy {policy.value}"
