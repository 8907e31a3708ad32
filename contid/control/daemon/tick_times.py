"""What the ticks of a robot file cost on this machine, and whether a run whose ticks do not fit may begin.

The ticks are those of a `MeasuredRun`. The slower half of them is left out: a busy machine, whose processors
share caches and pipelines, makes ticks take two or three times as long.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Final

from contid.control.daemon.budget import Budget, TickCost
from contid.control.daemon.measured_run import MOTIONS, MeasuredRun, measured_run
from contid.control.engine.cycle import Sink
from contid.errors import ContidError, MissingPackageError
from contid.robot_file.document import Isolation
from contid.robot_file.load import LoadedFile
from contid.robot_file.loader import robot_classes
from contid.robot_file.tick_rate import exchange_time

#: Robot time of the looks before a run, and the longest time of arming and of measuring in each [s]. Three: a
#: machine that lowers the clock of its processors for 0.1 s makes any ticks too long.
LOOKS_S: Final = (0.1, 0.3, 0.3)
LOOK_S: Final = 0.5

log = logging.getLogger(__name__)


def measure_budget(
    loaded: LoadedFile,
    rate_hz: float,
    virtual_s: float,
    longest_s: float,
    motions: Sequence[str] = MOTIONS,
    records: Sink | None = None,
) -> Budget:
    """Measure what a tick of a file costs on this machine.

    Args:
        loaded: the robot file; its devices are simulated.
        rate_hz: of the tick.
        virtual_s: robot time of each kind of motion.
        longest_s: time of each, in all.
        motions: of `MOTIONS`, in this order.
        records: gets the ticks of as much of the last motion again, which is not measured.

    Raises:
        ContidError: the simulated robots cannot be built.
    """
    own = frozenset(
        name
        for name, bus in loaded.buses.items()
        if bus.driver == "sim" and bus.isolation is not Isolation.PROCESS
    )
    wires = {name: exchange_time(bus) for name, bus in loaded.buses.items()}
    wires_s = {name: wire.least_s for name, wire in wires.items() if wire is not None}
    with measured_run(loaded, rate_hz, longest_s) as measured:
        costs = tuple(_cost(measured, motion, virtual_s) for motion in motions)
        if records is not None:
            measured.sink.copies_to = records
            measured.ticks(motions[-1], virtual_s)
    return Budget(rate_hz, wires_s, own, costs)


def _cost(measured: MeasuredRun, motion: str, virtual_s: float) -> TickCost:
    """The mean cost of a tick of a motion, without the slower half of the ticks."""
    found = measured.ticks(motion, virtual_s)
    kept = sorted(found)[: (len(found) + 1) // 2]
    count = len(kept)
    robots = {name: sum(each.robots_s[k] for each in kept) / count for k, name in enumerate(measured.robots)}
    buses = {name: sum(each.buses_s[k] for each in kept) / count for k, name in enumerate(measured.buses)}
    rest_s = sum(each.whole_s for each in kept) / count - sum(robots.values()) - sum(buses.values())
    return TickCost(motion, robots, buses, max(rest_s, 0.0))


def check_budget(loaded: LoadedFile, rate_hz: float, motion: str) -> None:
    """Refuse a run whose ticks do not fit, before anything is opened.

    The first look is short; only where it finds that they may not fit there are others. Models of other
    distributions are not called here: what they do ends in the control process.

    Args:
        loaded: the robot file.
        rate_hz: of the tick.
        motion: of `MOTIONS`, what the robots are to do.

    Raises:
        ContidError: they do not fit, or simulated devices need a package that is not installed.
    """
    if not all(isinstance(robot, tuple(robot_classes().values())) for robot in loaded.driven.values()):
        return
    try:
        for virtual_s in LOOKS_S:
            budget = measure_budget(loaded, rate_hz, virtual_s, LOOK_S, (motion,))
            if not budget.refusal():
                return
            if budget.highest_rate_hz < 0.5 * rate_hz:
                break
    except Exception as error:  # what the robots do with it is theirs to find
        simulated = any(bus.driver == "sim" for bus in loaded.buses.values())
        if simulated and isinstance(error, MissingPackageError):
            raise  # the run needs the package, too
        log.warning("the time of a tick was not measured: %s: %s", type(error).__name__, error)
        return
    raise ContidError(f"{loaded.path}: {budget.refusal()}")
