"""`Sim`: the real control tick with simulated devices in virtual time, in this process.

The same engine as ``contid run --virtual``: approach, limits, watchdogs, faults and stops are those of a
robot. Units are those of robot files, or SI with ``si=True``.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Final, Literal, Self, TypeAlias

from contid.api.arguments import ArgumentError
from contid.api.units import Units
from contid.control.engine import messages as msg
from contid.control.engine.cycle import OnEnd, Sink
from contid.control.engine.events import RunEvent
from contid.control.engine.events.robots import OrderGiven
from contid.control.engine.virtual import Tee, VirtualProcess
from contid.control.engine.wiring import build_preflight, build_robot_configs, record_layout
from contid.control.process.pipe import RunSetup
from contid.control.tick.preflight.rows import Unreachable
from contid.control.tick.supervisor import Mode
from contid.errors import ContidError
from contid.html import html_table
from contid.robot_file.load import LoadedFile, load_named, with_mock
from contid.session.recording_observer import RecordingObserver
from contid_library.commands import Command, CommandReader
from contid_library.sim_state import SimState, StateReader
from contid_library.simulated_seed import with_seed

#: Greatest virtual time until every robot is armed [s]; simulated devices need some ticks.
ARMING_TIMEOUT_S: Final = 60.0
#: A checked robot file with other numbers of its simulated devices and bodies.
Variant: TypeAlias = Callable[[LoadedFile], LoadedFile]


class Sim:
    """A simulated run that a script advances tick by tick; the robots are armed and hold at first.

    Args:
        file: a robot file, or the name of a shipped one; its devices are simulated.
        si: m and Pa instead of mm and bar.
        rate_hz: rate of the tick; that of the file when left out.
        unreachable: ``refuse``: a robot holds while its target is out of reach; ``nearest``: it goes to
            the nearest point.
        record: a session file to write, as ``contid run --record``; complete after `close`.

    Attributes:
        names: names of the robots.
        rate_hz: rate of the tick.
        units: units of all arrays.
        state: after the newest tick.
        events: changes of mode, faults and refusals so far.

    Raises:
        ContidError: no such file, or it has mistakes; ``record`` exists.
    """

    def __init__(
        self,
        file: str | Path,
        *,
        si: bool = False,
        rate_hz: float | None = None,
        unreachable: Literal["refuse", "nearest"] = "refuse",
        record: str | Path | None = None,
    ) -> None:
        self._loaded = loaded = with_mock(load_named(str(file)))
        self._unreachable = Unreachable(unreachable)
        robots = loaded.driven
        self.names, self.units = tuple(robots), Units(si)
        self.rate_hz = float(loaded.file.rate_hz if rate_hz is None else rate_hz)
        if not 0.0 < self.rate_hz <= 1000.0:
            raise ArgumentError(f"rate_hz={rate_hz}: allowed: above 0, up to 1000")
        self.events: list[RunEvent] = []
        self._commands = CommandReader(robots, self.units)
        self._preflight = build_preflight(loaded, self.rate_hz, self._unreachable)
        self._recording: RecordingObserver | None = None
        self._sink: Sink = self
        if record is not None:
            options = {"mock": "True", "unreachable": unreachable, "input": "contid.Sim"}
            self._recording = RecordingObserver(Path(record), options)
            setup = RunSetup(loaded, self.rate_hz, Path(), None, OnEnd.HOLD, attended=True)
            self._sink = Tee([self, self._recording.follow(setup)])
        configs = build_robot_configs(loaded, self.rate_hz)
        self._states = StateReader(record_layout(loaded, self.rate_hz), configs, self.units)
        self._closed = False
        self._refused: dict[str, str] = {}
        self._values: list[float] = []
        try:
            self.state = self._begin(loaded)
        except BaseException:
            if self._recording is not None:
                self._recording.detach()
            raise

    def step(self, u: Command | None = None, *, ticks: int = 1) -> SimState:
        """Advance by some ticks towards a target; without one the robots go on to the previous target.

        Args:
            u: the actuation of the only robot (columns as `Robot.axes`); or actuations by robot,
                ``{"left": [50, 70]}``; or columns of a trajectory, ``{"left.x_mm": 10, "left.y_mm": 90}``
                (always in the units of their names).
            ticks: how many.

        Raises:
            ArgumentError: the target has a wrong shape, name or value.
            ContidError: the simulation is closed.
        """
        self._check_open()
        if ticks < 1:
            raise ArgumentError(f"ticks={ticks}: at least 1")
        if u is not None:
            targets = self._commands.targets(u)
            wrong = {} if self._preflight is None else self._preflight.row(targets)
            self._refused = {name: why for name, why in self._refused.items() if name not in targets} | wrong
            self._obey(msg.Rows({**targets, **dict.fromkeys(wrong)}))
        for _ in range(ticks):
            self._run_tick()
        self.state = self._states.read(self._values, self._refused)
        return self.state

    def reset(self, seed: int | None = None, *, variant: Variant | None = None) -> SimState:
        """Begin again: devices at their start, robots armed; everything as after the constructor, to the bit.

        Args:
            seed: of the noise of every simulated device and tracker; that of the file when left out.
            variant: changes what is simulated, and not what the control loop assumes of it.

        Raises:
            ContidError: the simulation is closed, or it records: a session is one run.
        """
        self._check_open()
        if self._recording is not None:
            raise ContidError("this simulation records, and a session is one run; make a new one")
        loaded = self._loaded if variant is None else variant(self._loaded)
        if seed is not None:
            loaded = with_seed(loaded, seed)
        self._process.close()
        self.events.clear()
        self._preflight = build_preflight(self._loaded, self.rate_hz, self._unreachable)
        self.state = self._begin(loaded)
        return self.state

    def hold(self) -> None:
        """Every robot stops with its jerk limit and holds, from the next step on."""
        self._obey(msg.Hold())

    def clear_fault(self) -> None:
        """Re-check all devices and leave FAULT; `resume` arms again."""
        self._obey(msg.ClearFault())

    def resume(self) -> None:
        """Arm if need be and follow the previous target again."""
        self._obey(msg.Resume())

    def close(self) -> None:
        """Close the devices, and complete the recording. Idempotent."""
        if self._closed:
            return
        self._closed = True
        self._process.close()
        if self._recording is not None:
            self._recording.detach()

    def _repr_html_(self) -> str:
        rows = [
            (name, each.mode, each.command.tolist(), each.measured.tolist(), each.tip.tolist())
            for name, each in self.state.robots.items()
        ]
        caption = f"{self._loaded.path.name}, simulated: {self.state.time_s:.3f} s"
        return html_table(caption, ("robot", "mode", "command", "measured", "tip"), rows)

    def __enter__(self) -> Self:
        """Close on leaving."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    # -- a sink of the engine ----------------------------------------------------------------------------

    def write(self, values: list[float]) -> None:
        """One tick, all values of the layout in order (`contid.control.engine.cycle.Sink`)."""
        self._values = values

    def event(self, event: RunEvent) -> None:
        """One event (`contid.control.engine.cycle.Sink`)."""
        if not isinstance(event, OrderGiven):  # every step emits one
            self.events.append(event)

    def _begin(self, loaded: LoadedFile) -> SimState:
        """Open the devices of a file, and arm."""
        self._refused, self._values = {}, []
        self._process = VirtualProcess(loaded, self.rate_hz, self._sink, on_end=OnEnd.HOLD, attended=True)
        return self._arm()

    def _arm(self) -> SimState:
        """Run ticks until every robot is armed, or all are in FAULT."""
        engine = self._process.engine
        engine.arm()
        while not engine.robots.armed or self._process.cycles == 0:
            self._run_tick()
            if all(self._states.mode(self._values, k) is Mode.FAULT for k in range(len(self.names))):
                break
            if self._process.tick > ARMING_TIMEOUT_S * self.rate_hz:
                raise ContidError(f"the simulated robots were not armed within {ARMING_TIMEOUT_S:g} s")
        return self._states.read(self._values, self._refused)

    def _check_open(self) -> None:
        if self._closed:
            raise ContidError("this simulation is closed; make a new one")

    def _obey(self, message: msg.Message) -> None:
        self._check_open()
        self._process.engine.obey(message, self._process.tick)

    def _run_tick(self) -> None:
        self._process.begin()
        self._process.turn()
