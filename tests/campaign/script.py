"""What one case of the campaign consists of, and how it is drawn from a seed.

A case is a robot file, a source, orders at random instants, and faults of the simulated buses. Every case
ends alike: all faults are over, the robots are cleared and resumed, and everything is finished; or the host
dies at a random instant instead.
"""

from __future__ import annotations

import io
import math
import random
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from benchmarks.lab import lab
from contid.control.engine import messages as msg
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.robot_file.base import StopPolicy
from contid.robot_file.load import LoadedFile, configs_folder, load_robot_file, parse_robot_file, with_mock
from contid.targets import Target
from contid.trajectory.read import read_trajectory
from contid.trajectory.timed import Trajectory
from contid_drivers.sim.options import MECHANICAL, OF_AN_AXIS, FaultKind, ScheduledFault

#: All faults are over by then; what follows shows that the robots can be had back.
SCRIPT_S = 1.2
#: A lost bus is tried again once a second, and a fault may end at the end of the script.
HEALED_S = SCRIPT_S + 1.2
RESUMED_S = HEALED_S + 0.5
FINISH_S = RESUMED_S + 0.1


#: Gains of the feedback of robots whose simulated bodies swing [1/s].
MOVING = {"bend1": 0.5, "chambers3": 0.5, "stiffflop1": 0.5, "stiffflop2": 0.3, "tendon3": 0.5}


@dataclass(frozen=True)
class Machine:
    """A robot file on simulated buses, with what a case needs to know of it."""

    name: str
    loaded: LoadedFile
    rate_hz: float
    configs: tuple[RobotConfig, ...]

    @property
    def bus_of(self) -> dict[str, str]:
        """Bus by axis."""
        return {axis: bus.name for bus in self.loaded.buses.values() for axis, _ in bus.axes}


#: `rates.shape` of robots whose commands are shaped as well.
SHAPES = {
    "stiffflop1": "{kind: zv, frequency_hz: 1.6, damping_ratio: 0.05}",
    "stiffflop2": "{kind: zvd, frequency_hz: 2.2, damping_ratio: 0.05, schedule: {middle: MIDDLE, "
    "half: HALF, least_hz: 1.1, most_hz: 4.0, first: FIRST, second: SECOND}}",
    "tendon3": "{kind: zvd, frequency_hz: 7.4, damping_ratio: 0.07}",
}


def machines() -> list[Machine]:
    """Every shipped robot file with actuators, a laboratory, a close hand, shaped and moving ones."""
    files = [
        load_robot_file(path)
        for path in sorted(configs_folder().glob("*.yaml"))
        if not path.stem.endswith(".emulated")
    ]
    out = []
    for loaded in [*files, lab(), close_hand(), *map(shaped, SHAPES), *map(moving, MOVING)]:
        if loaded.driven:
            rate = loaded.file.rate_hz
            out.append(Machine(loaded.file.name, with_mock(loaded), rate, build_robot_configs(loaded, rate)))
    return out


def close_hand() -> LoadedFile:
    """The hand with its fingers so near to each other that random targets cross them."""
    text = (configs_folder() / "hand.yaml").read_text(encoding="utf-8")
    moved = text.replace("name: hand", "name: close_hand").replace("base: {x_mm: 100,", "base: {x_mm: 50,")
    return parse_robot_file(moved, "close_hand.yaml")


def shaped(name: str) -> LoadedFile:
    """A shipped robot whose commands are shaped; a schedule is one of six axes."""
    slopes = [0.1, -0.08, 0.05, 0.12, -0.06, 0.04]
    numbers = {"FIRST": [0.6, *slopes, *[0.02] * 21], "SECOND": [0.8, *slopes, *[-0.02] * 21]}
    shape = SHAPES[name]
    for key, values in {**numbers, "MIDDLE": [0.5] * 6, "HALF": [0.5] * 6}.items():
        shape = shape.replace(key, str(values))
    return _changed(name, "shaped", f"    rates:\n      shape: {shape}\n")


def moving(name: str) -> LoadedFile:
    """A shipped robot whose simulated body has mass and a payload; its measured tip corrects the commands."""
    sim = "{dynamics: true, payload_g: 2, tracker: {noise_mm: 0.3, rate_hz: 100, latency_ms: 10}}"
    keys = f"    sim: {sim}\n    feedback: {{gain_per_s: {MOVING[name]}}}\n    rates:\n"
    return _changed(name, "moving", keys)


def _changed(name: str, how: str, keys: str) -> LoadedFile:
    """A shipped file with another name, and with these lines in place of that of its key ``rates``."""
    text = (configs_folder() / f"{name}.yaml").read_text(encoding="utf-8")
    text = text.replace(f"name: {name}", f"name: {name}_{how}", 1)
    changed = text.replace("    rates:\n", keys, 1)
    assert changed != text
    return parse_robot_file(changed, f"{name}_{how}.yaml")


@dataclass(frozen=True)
class Fault:
    """One fault; it is on for the exchanges of ``ticks`` ticks from ``tick`` on."""

    kind: FaultKind
    bus: str
    axis: str | None
    tick: int
    ticks: int
    delay_ms: float = 20.0

    def scheduled(self, rate_hz: float) -> ScheduledFault:
        """As the simulated bus takes it; edges lie between two ticks."""
        late: dict[str, Any] = {"delay_ms": self.delay_ms} if self.kind is FaultKind.LATE else {}
        begin_s, for_s = (self.tick - 0.5) / rate_hz, self.ticks / rate_hz
        return ScheduledFault(at_s=begin_s, kind=self.kind, axis=self.axis, for_s=for_s, **late)

    def touches(self, machine: Machine, config: RobotConfig) -> bool:
        """True when the robot may notice it."""
        if self.axis is not None:
            return self.axis in config.axes
        return any(machine.bus_of[axis] == self.bus for axis in config.axes)


@dataclass(frozen=True)
class Case:
    """One run of the engine."""

    machine: Machine
    number: int
    armed: bool
    trajectory: Trajectory | None
    orders: Mapping[int, tuple[msg.Message, ...]]
    faults: tuple[Fault, ...] = ()
    dies_at: int | None = None
    #: The newest fault, and the state of its robot in the case without it.
    hits: tuple[tuple[str, str], ...] = ()

    @property
    def coupled(self) -> bool:
        """True when robots wait for each other: a timed trajectory starts once all of them are there."""
        return self.trajectory is not None or any(
            isinstance(message, msg.Play) for given in self.orders.values() for message in given
        )

    def loaded(self) -> LoadedFile:
        """The robot file with the faults on its buses."""
        buses = {}
        for name, bus in self.machine.loaded.buses.items():
            faults = tuple(f.scheduled(self.machine.rate_hz) for f in self.faults if f.bus == name)
            options = bus.options.model_copy(update={"faults": faults, "seed": self.number})
            buses[name] = replace(bus, options=options)
        return replace(self.machine.loaded, buses=buses)


@dataclass
class Script:
    """Draws cases from one seed."""

    machine: Machine
    number: int
    seed: int
    random: random.Random = field(init=False)

    def __post_init__(self) -> None:
        self.random = random.Random(f"{self.seed}:{self.number}")

    def tick(self, seconds: float) -> int:
        return round(seconds * self.machine.rate_hz)

    def case(self) -> Case:
        """A case without faults."""
        draw, configs = self.random, self.machine.configs
        source = draw.choice(("timed", "live", "live", "none"))
        trajectory = self._trajectory() if source == "timed" else None
        orders: dict[int, list[msg.Message]] = {}
        armed = draw.random() < 0.85
        if not armed:
            orders.setdefault(draw.randint(1, self.tick(0.2)), []).append(msg.Resume())
        for _ in range(draw.randint(0, 8)):
            tick = draw.randint(0, self.tick(SCRIPT_S))
            orders.setdefault(tick, []).append(self._order(source))
        if source == "live":
            for _ in range(draw.randint(1, 12)):
                tick = draw.randint(0, self.tick(SCRIPT_S))
                some = [p for p in configs if draw.random() < 0.8]
                row = {p.name: None if draw.random() < 0.1 else self._target(p) for p in some}
                orders.setdefault(tick, []).append(msg.Rows(row))
        for seconds in (HEALED_S, RESUMED_S - 0.1):
            orders.setdefault(self.tick(seconds), []).append(msg.ClearFault())
            orders.setdefault(self.tick(seconds) + 2, []).append(msg.Resume())
        orders.setdefault(self.tick(FINISH_S), []).append(msg.Finish())
        # A script in a loop that does not notice the end must not hold it up.
        for later in range(1, 200, 7):
            orders.setdefault(self.tick(FINISH_S) + later, []).append(msg.Resume())
        given = {tick: tuple(messages) for tick, messages in orders.items()}
        return Case(self.machine, self.number, armed, trajectory, given)

    def with_fault(self, case: Case, modes: Mapping[str, list[str]]) -> Case:
        """The case with one more fault, at an instant drawn evenly over the states, not over time.

        Args:
            case: as it was run before.
            modes: per robot the state after every tick of that run.
        """
        draw, machine = self.random, self.machine
        config = draw.choice(machine.configs)
        first, last = 1, self.tick(SCRIPT_S) - 1
        ticks_of: dict[str, list[int]] = {}
        for tick, mode in enumerate(modes[config.name][first - 1 : last], first):
            ticks_of.setdefault(mode, []).append(tick)
        mode = draw.choice(sorted(ticks_of))
        tick = draw.choice(ticks_of[mode])
        axis = draw.choice(config.axes)
        # The end of a fault ends every other one of its kind in the same place.
        taken = {(f.kind, f.axis or f.bus) for f in case.faults}
        # Damage of a body is not reported: it has no bound on the ticks until a robot is in FAULT.
        reported = [k for k in FaultKind if k not in MECHANICAL]
        kinds = [k for k in reported if not taken & {(k, axis), (k, machine.bus_of[axis])}]
        kind = draw.choice(kinds)
        longest = max(self.tick(SCRIPT_S) - tick, 1)
        ticks = min(draw.choice((1, 2, 3, 4, 5, 20, 60, longest)), longest)
        fault = Fault(
            kind, machine.bus_of[axis], axis if kind in OF_AN_AXIS else None, tick, ticks,
            delay_ms=draw.choice((0.5, 3.0, 20.0, 150.0)),
        )  # fmt: skip
        orders = {tick: list(given) for tick, given in case.orders.items()}
        for order in (msg.ClearFault((config.name,)), msg.Resume((config.name,))):
            if draw.random() < 0.6:
                orders.setdefault(draw.randint(tick, self.tick(SCRIPT_S)), []).append(order)
        given = {tick: tuple(messages) for tick, messages in orders.items()}
        dies_at = draw.randint(tick, self.tick(SCRIPT_S)) if draw.random() < 0.1 else None
        hits = (*case.hits, (kind.value, mode))
        return replace(case, faults=(*case.faults, fault), orders=given, dies_at=dies_at, hits=hits)

    def _order(self, source: str) -> msg.Message:
        draw, configs = self.random, self.machine.configs
        who = None if draw.random() < 0.4 else (draw.choice(configs).name,)
        kind = draw.choice(("hold", "resume", "resume", "stop", "estop", "goto", "clear", "play"))
        match kind:
            case "hold":
                return msg.Hold(who)
            case "resume":
                return msg.Resume(who)
            case "stop":
                return msg.Stop(who, draw.choice((None, StopPolicy.HOLD, StopPolicy.REST, StopPolicy.RELAX)))
            case "estop":
                return msg.Estop(who)
            case "clear":
                return msg.ClearFault(who)
            case "play" if source == "timed":
                return msg.Play(self._trajectory())
        config = draw.choice(configs)
        return msg.Goto(config.name, self._target(config))

    def _actuation(self, config: RobotConfig, beyond: float) -> list[float]:
        """Any value of every axis, extra ones included; ``beyond`` is a share of the range outside of it."""
        draw = self.random
        return [
            draw.uniform(a.lower - beyond * (a.upper - a.lower), a.upper + beyond * (a.upper - a.lower))
            for a in config.limits
        ]

    def _target(self, config: RobotConfig) -> Target:
        """Actuation or tip, now and then out of reach."""
        draw, own = self.random, len(config.axes) - config.extra_axes
        values = self._actuation(config, draw.choice((0.0, 0.0, 0.3)))
        extra = dict(zip(config.axis_names[own:], values[own:], strict=True)) if draw.random() < 0.5 else {}
        if draw.random() < 0.5:
            return Target(actuation=tuple(values[:own]), extra=extra)
        x, y, z = (value + draw.gauss(0.0, 0.03) for value in config.model.forward(config.rest).tip_m)
        tip = (x, y, 0.0 if config.kind == "rack_finger" else z)
        return Target(tip_m=config.frame.point_in_world(tip), extra=extra)

    def _trajectory(self) -> Trajectory:
        """A smooth walk of every axis, from a first row to a last at speed."""
        draw, rows = self.random, 12
        names, columns = ["t_s"], []
        length_s = draw.choice((0.3, 1.0, 3.0))
        columns.append([length_s * row / (rows - 1) for row in range(rows)])
        for config in self.machine.configs:
            names += [f"{config.name}.{axis}_{config.quantity.unit}" for axis in config.axis_names]
            begins, ends = self._actuation(config, 0.0), self._actuation(config, 0.0)
            for begin, end in zip(begins, ends, strict=True):
                share, turn = draw.uniform(0.02, 0.3), draw.uniform(0.5, 2.0) * math.pi / rows
                way = [share * (0.5 - 0.5 * math.cos(turn * row)) for row in range(rows)]
                columns.append([(begin + (end - begin) * part) * config.quantity.per_si for part in way])
        lines = [",".join(names), *(",".join(map(repr, row)) for row in zip(*columns, strict=True))]
        return read_trajectory(io.StringIO("\n".join(lines) + "\n"), "walk.csv", self.machine.loaded.driven)
