"""The fault campaign on wires, in real time: the whole daemon with its real drivers against emulated devices.

``python -m tests.campaign --ptys N`` runs N cases from a seed, some on one daemon, and prints counts. A
case brings the laboratory (`tests.campaign.wired.wires`) into a state, throws one fault switch at a random
instant, perhaps gives an order, heals everything, and has every robot back. A daemon ends by SIGTERM, or by a
second Ctrl-C, in a random state. The session it recorded is then held against the invariants.
"""

from __future__ import annotations

import math
import random
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from tests.campaign.wired.checks import STATES, Injected, Tally
from tests.campaign.wired.daemon import NotStartedError, WiredDaemon
from tests.campaign.wired.lab_file import RATE_HZ, TOLERANCE_TICKS
from tests.campaign.wired.switches import Switch
from tests.support.waiting import until

ORDERS: Final = ("", "", "", "estop", "stop", "hold", "resume", "clear_fault")
#: Cases that one daemon sees.
PER_DAEMON: Final = 6
#: More have another cause than a busy machine.
MOST_FAILED_STARTS: Final = 5
#: Until a fault that a healed device reports is latched.
NOTICED_TICKS: Final = TOLERANCE_TICKS + 2
#: Two places of every axis or tip [mm], by robot; the way between them takes most of a second.
PLACES: Final[dict[str, tuple[dict[str, float], dict[str, float]]]] = {
    **{
        robot: ({"left": 30.0, "right": 30.0}, {"left": 60.0, "right": 60.0})
        for robot in ("hand_left", "hand_right")
    },
    "trirack_arm": tuple({f"s1.l{n}": value for n in (1, 2, 3)} for value in (60.0, 120.0)),  # type: ignore[dict-item]
    "cbha_cbha": tuple(
        {f"s1.l{n}": 100.0 + rise for n in (1, 2, 3)} | {f"s2.l{n}": 90.0 + rise for n in (1, 2, 3)}
        for rise in (5.0, 35.0)
    ),  # type: ignore[dict-item]
    "tendon3_arm": ({"x": 70.0, "y": 10.0, "z": 270.0}, {"x": 10.0, "y": 70.0, "z": 270.0}),
}

#: Switches that restart a board, by its bus. A motor without homing has lost its position then: it must
#: not move until a person has parked it, which no order to the daemon does.
LOSES_POSITION: Final = {"trirack_motors": frozenset({"reset", "brown_out", "freeze"})}


class Run(WiredDaemon):
    """One daemon and the cases it sees."""

    def play(self, cases: int) -> None:
        """Several cases, then the end in a random state."""

        def body() -> None:
            for _ in range(cases):
                if not self._case():
                    break
            self._end(self._dice.choice(STATES), twice=self._dice.random() < 0.5)

        self._session(body)

    def stop_everywhere(self, states: Sequence[str]) -> None:
        """An estop in every state, without any fault."""

        def body() -> None:
            for state in states:
                self._bring(state)
                begin_s = time.monotonic()
                self._client.estop()
                self._relaxed(begin_s, state)
                self._tally.check("controllable", self._back())
            self._end("hold", twice=False)

        self._session(body)

    def throw(self, state: str, bus: str, switch: str, axis: str) -> dict[str, str]:
        """One case that is not drawn; states some ticks later."""
        later: dict[str, str] = {}

        def body() -> None:
            self._bring(state)
            chosen = next(each for each in self._wires.switches(bus) if each.name == switch)
            names = [each.name for each in self._wires.buses[bus].axes]
            self._throw(state, bus, chosen, names.index(axis))
            time.sleep(2.0 * NOTICED_TICKS / RATE_HZ)
            later.update(self._state_of())
            self._end("hold", twice=False)

        self._session(body)
        return later

    def interrupt_twice(self, state: str) -> None:
        """Ctrl-C twice in a state, without any fault."""
        self._session(lambda: self._end(state, twice=True))

    def _case(self) -> bool:
        """False when not every robot could be had back: the daemon ends."""
        dice = self._dice
        state = STATES[(self._number * PER_DAEMON + self._tally.cases) % len(STATES)]
        self._bring(state)
        time.sleep(dice.uniform(0.0, 0.15))
        bus = dice.choice(sorted(self._wires.buses))
        switch = dice.choice(self._wires.switches(bus))
        axis = dice.randrange(len(self._wires.buses[bus].axes))
        return self._throw(state, bus, switch, axis)

    def _throw(self, state: str, bus: str, switch: Switch, axis: int) -> bool:
        """One switch on, perhaps an order, every switch off; False when not every robot could be had back."""
        dice, tally = self._dice, self._tally
        axes = [axis.name for axis in self._wires.buses[bus].axes]
        robots = frozenset(name.split(".")[0] for name in axes)
        concerned = frozenset({axes[axis].split(".")[0]}) if switch.on_axis else robots
        injected = Injected(bus, switch, state, robots, concerned, time.monotonic())
        self._wires.throw(bus, switch, axis, dice)
        self._injected.append(injected)
        tally.cases += 1
        tally.faults[f"{self._wires.buses[bus].wiring.driver} {switch.name}", state] += 1
        order = dice.choice(ORDERS)
        if order:
            time.sleep(dice.uniform(0.0, 0.3))
            injected.order_s = time.monotonic()
            self._order(order)
            if order == "estop":
                # A faulty device may miss it; the others must not.
                self._relaxed(injected.order_s, state, frozenset({axes[axis]} if switch.on_axis else axes))
        time.sleep(dice.uniform(0.4, 0.6))
        injected.until_s = time.monotonic()
        if switch.name in LOSES_POSITION.get(bus, ()):
            self.lost = robots
        self._wires.heal()
        # What a healed switch leaves behind, as a position that jumps, is of this case and not of the next.
        noticed = self._tick() + NOTICED_TICKS
        until(lambda: self._tick() > noticed, "the daemon has seen the healed devices")
        back = self._back()
        injected.latest_s = time.monotonic()
        tally.check("controllable", back)
        return not back and not self.lost

    def _bring(self, state: str) -> None:
        """Into a state; a robot or two may have another one, by chance."""
        client, dice = self._client, self._dice
        client.acquire(60.0, takeover=True)
        self._place = 1 - self._place
        if state == "run":
            columns, rows = self._rows()
            begun = self._insist(lambda: client.request("move", columns=columns))
            if begun is None:
                return
            client.request("rows", move=begun["move"], rows=rows)
            client.request("end", move=begun["move"])
            until(lambda: "RUN" in self._states() or "FAULT" in self._states(), "it runs")
            return
        if state in ("approach", "stopping"):
            target = {
                f"{robot}.{axis}_mm": value
                for robot, places in self._places.items()
                for axis, value in places[self._place].items()
            }
            self._insist(lambda: client.move(target, wait=False))
            time.sleep(dice.uniform(0.05, 0.3))
        if state == "stopping":
            client.stop()
        elif state == "fault":
            probe = dice.choice(self._wires.servos)
            robot = frozenset({probe.axis.split(".")[0]})
            bus = next(
                name
                for name in self._wires.benches
                if probe.axis in {axis.name for axis in self._wires.buses[name].axes}
            )
            emulator = self._wires.benches[bus].emulator
            by_hand = Injected(bus, Switch("trip", True), state, robot, robot, time.monotonic())
            by_hand.latest_s = math.inf
            self._injected.append(by_hand)
            emulator.set("trip", probe.servo.device)
            until(lambda: "FAULT" in self._states(), "FAULT")
        elif state == "arming":
            client.estop()
            self._order("resume")

    @property
    def _places(self) -> dict[str, tuple[dict[str, float], dict[str, float]]]:
        """Places of the robots that can be moved."""
        there = self._wires.loaded.file.robots.keys() - self.lost
        return {robot: places for robot, places in PLACES.items() if robot in there}

    def _rows(self) -> tuple[list[str], list[list[float]]]:
        """Every axis up and down, slowly enough for all of them."""
        columns, middles = ["t_s"], []
        for robot, (low, high) in self._places.items():
            for axis in low:
                columns.append(f"{robot}.{axis}_mm")
                middles.append((low[axis] + high[axis]) / 2.0)
        rows = []
        for row in range(100):
            swing = 8.0 * math.sin(row / 100 * math.tau * 3.0)
            rows.append([0.05 * row, *(middle + swing for middle in middles)])
        return columns, rows

    def _end(self, state: str, twice: bool) -> None:
        self._bring(state)
        time.sleep(self._dice.uniform(0.0, 0.1))
        self._terminate(state, twice)


def campaign(
    cases: int,
    seed: int,
    progress: Callable[[Tally], None] | None = None,
    driver: str = "",
    keep: Path | None = None,
) -> Tally:
    """Run cases, several of them with each daemon, on the buses of a driver or on all.

    Sessions that broke an invariant are copied to the folder ``keep``.
    """
    tally, begin_s = Tally(seed, keep=keep), time.monotonic()
    number = 0
    while tally.cases < cases:
        before = tally.cases
        run = Run(random.Random(f"{seed}:{number}"), tally, number, driver=driver)
        number += 1
        try:
            run.play(min(PER_DAEMON, cases - tally.cases))
        except NotStartedError as error:
            tally.failed_starts.append(str(error))
            if len(tally.failed_starts) > MOST_FAILED_STARTS:
                raise
            continue
        tally.seconds = time.monotonic() - begin_s
        if progress is not None:
            progress(tally)
        if tally.cases == before:
            break
    return tally
