"""Random touches of sliders through the checks of the daemon: what is ordered moves, or has a reason.

A touch is a row in which one number of the last order is replaced, as `hand` of `static/robots.js` makes it;
the rest is what the socket does with it (`contid.remote.server.moves`), on robots that are always where they
were ordered to. `CONTID_TOUCHES=10000` gives the length of the campaign.
"""

from __future__ import annotations

import math
import os
import random
from dataclasses import dataclass, field
from itertools import product

import pytest

from contid.control.engine.wiring import build_robot_configs, chain_guards, clearance_of
from contid.control.tick.preflight.edge import along_the_edge, off_the_reach_m
from contid.control.tick.preflight.rows import Preflight
from contid.errors import BadInputError
from contid.kinematics.model import Bending
from contid.robot_file.load import load_named
from contid.targets import Actuation, Target
from contid.trajectory.arc_columns import arc_names, arc_values
from contid.trajectory.columns import column_groups
from contid.trajectory.rows import RowReader
from contid.units import MM_PER_M
from tests.support.daemons import BLOCKED, SHIPPED

#: What a coordinate that was not touched may change by [mm, or the unit of the axis].
UNTOUCHED = 1e-6
#: Steps of keys: of a tip or a length [mm], of a bend or azimuth [deg]; of an axis a share of its range.
STEPS = {"mm": 0.5, "deg": 0.5}
OF_RANGE = 1e-3
#: A bend below which its azimuth turns nothing [deg], and what a touch moves at the least, as a share of it.
STRAIGHT_DEG, MOVED_SHARE = 0.1, 5e-3
TOUCHES = int(os.environ.get("CONTID_TOUCHES", "200"))


@dataclass
class Touched:
    """The robots of a file under the hands of one person.

    Attributes:
        at: where every robot is commanded to.
        wrong: touches that did not move and had no reason, and coordinates that moved unasked.
    """

    name: str
    at: dict[str, Actuation] = field(default_factory=dict)
    moved: int = 0
    refused: int = 0
    wrong: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.loaded = load_named(self.name)
        self.configs = {each.name: each for each in build_robot_configs(self.loaded, 100.0)}
        self.guards, self.clearance = chain_guards(self.loaded), clearance_of(self.loaded)
        self.rest()

    def rest(self) -> None:
        self.at = {name: config.rest for name, config in self.configs.items()}

    def groups(self, robot: str) -> dict[str, list[str]]:
        """Columns of the sliders of a robot: of its tip, its bends, its axes."""
        description, model = self.loaded.driven[robot], self.configs[robot].model
        found = {"tip": column_groups("", description).get("tip", []), "axes": list(description.columns)}
        if "arcs" in description.accepts and isinstance(model, Bending):
            found["bends"] = list(arc_names(description))
        return {group: columns for group, columns in found.items() if columns}

    def values(self, robot: str, group: str) -> list[float]:
        """What the sliders show."""
        config, at = self.configs[robot], self.at[robot]
        if group == "axes":
            return [value * each.per_si for value, each in zip(at, config.quantities, strict=True)]
        if group == "bends":
            assert isinstance(config.model, Bending)
            return arc_values(self.loaded.driven[robot], config.model.arcs(at).tolist())
        tip = config.frame.point_in_world(config.model.forward(at).tip_m)
        return [value * MM_PER_M for value in tip[: config.model.dimension]]

    def touch(self, robot: str, group: str, number: int, steps: float) -> bool:
        """One key of one slider; True when the robot moves."""
        columns, before = self.groups(robot)[group], self.values(robot, group)
        row = list(before)
        row[number] += steps * self.step(robot, group, number)
        if columns[number].endswith("bend_deg") and self.configs[robot].model.dimension == 3:
            row[number] = max(row[number], 0.0)  # the end of the slider: the other side is an azimuth
        if abs(row[number] - before[number]) < UNTOUCHED:
            return False
        what = f"{self.name} {robot} {columns[number]} {before[number]:.6g} to {row[number]:.6g}"
        prefix = f"{robot}." if len(self.configs) > 1 else ""
        reader = RowReader(",".join(prefix + each for each in columns), "rows", self.loaded.driven)
        try:
            target = reader.layout.targets(reader.row(row, 1))[robot]
        except BadInputError as error:
            return self._refused(str(error), what)
        why = self._check(robot, target)
        if not why and off_the_reach_m(self.configs[robot], target, self._here(robot), self.at[robot]) > 0.0:
            why = "this leads out of its reach"
        led = None
        if why:
            led = along_the_edge(self.configs[robot], target, self._here(robot), self.at[robot])
            if led is None or self._check(robot, led):
                return self._refused(why, what)
        config = self.configs[robot]
        solved = config.model.inverse(config.frame.target_in_base(led or target), self.at[robot])
        found = solved.actuation
        self.at[robot] = (*found, *self.at[robot][len(found) :])
        after = self.values(robot, group)
        if led is None:
            turned = group == "bends" and columns[number].endswith("azimuth_deg")
            others = [
                abs(a - b)
                for k, (a, b) in enumerate(zip(after, before, strict=True))
                if k != number and not (group == "bends" and columns[k].endswith("azimuth_deg"))
            ]
            tolerance = UNTOUCHED + MM_PER_M * solved.residual_m * (group == "tip")
            if others and max(others) > tolerance:
                self.wrong.append(f"{what}: another coordinate changed by {max(others):.3g}")
            if not turned and abs(after[number] - row[number]) > abs(row[number] - before[number]):
                self.wrong.append(f"{what}: it went to {after[number]:.6g}")
        way = math.dist(after, before)
        if way < MOVED_SHARE * abs(row[number] - before[number]) and not self._is_straight(
            robot, columns[number]
        ):
            self.wrong.append(f"{what}: taken, and nothing moved")
        self.moved += 1
        return True

    def step(self, robot: str, group: str, number: int) -> float:
        if group != "axes":
            return STEPS[self.groups(robot)[group][number].rpartition("_")[2]]
        config = self.configs[robot]
        own = len(config.model.lower)
        if number >= own:
            return 1.0
        range_si = config.model.upper[number] - config.model.lower[number]
        return OF_RANGE * range_si * config.quantities[number].per_si

    def _is_straight(self, robot: str, column: str) -> bool:
        if not column.endswith("azimuth_deg"):
            return False
        names = arc_names(self.loaded.driven[robot])
        bend = names.index(column.replace("azimuth", "bend"))
        return self.values(robot, "bends")[bend] < STRAIGHT_DEG

    def _here(self, robot: str) -> Target:
        config, at = self.configs[robot], self.at[robot]
        tip = config.frame.point_in_world(config.model.forward(at).tip_m)
        arcs = config.model.arcs(at) if isinstance(config.model, Bending) else None
        return Target(tip_m=tip, arcs=None if arcs is None else tuple(arcs.ravel().tolist()))

    def _check(self, robot: str, target: Target) -> str:
        configs = tuple(self.configs.values())
        check = Preflight(configs, self.guards, seeds=dict(self.at), clearance=self.clearance)
        return "; ".join(check.row({robot: target}).values())

    def _refused(self, why: str, what: str) -> bool:
        self.refused += 1
        if len(why.strip()) < 10:
            self.wrong.append(f"{what}: refused without a reason: {why!r}")
        return False


@pytest.mark.parametrize("name", SHIPPED)
def test_the_first_touch_moves_in_every_free_direction(name: str) -> None:
    """From rest every slider moves one way or the other, but for those that cannot move alone."""
    hands = Touched(name)
    dead = []
    for robot in hands.configs:
        for group, columns in hands.groups(robot).items():
            for number, column in enumerate(columns):
                ways = []
                for sign in (1.0, -1.0):
                    hands.rest()
                    ways.append(hands.touch(robot, group, number, sign))
                if not any(ways):
                    dead.append(f"{robot} {column}")
    assert hands.wrong == []
    assert dead == BLOCKED.get(name, [])


@pytest.mark.campaign
@pytest.mark.timeout(7200)
def test_random_touches() -> None:
    """Sliders of all shipped robots, up to six keys after one another, back to rest now and then."""
    numbers = random.Random(TOUCHES)
    wrong: list[str] = []
    all_hands = [Touched(name) for name in SHIPPED]
    for hands, _ in product(all_hands, range(math.ceil(TOUCHES / len(all_hands) / 3.5))):
        robot = numbers.choice(list(hands.configs))
        group = numbers.choice(list(hands.groups(robot)))
        number = numbers.randrange(len(hands.groups(robot)[group]))
        steps = numbers.choice((1, -1)) * 10 ** numbers.uniform(-1.0, 1.0)
        if numbers.random() < 0.05:
            hands.rest()
        for _ in range(numbers.randint(1, 6)):
            hands.touch(robot, group, number, steps)
    wrong = [text for hands in all_hands for text in hands.wrong]
    print({hands.name: (hands.moved, hands.refused) for hands in all_hands})
    assert wrong == []
