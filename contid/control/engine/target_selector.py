"""Which source of targets the robots follow, and how its end is that of the run.

=======================================  ================================================================
event                                    then
=======================================  ================================================================
the source is finished                   ``ended``; by ``on_end`` the robots hold, or the run finishes
every robot is in FAULT, no client       the run finishes
an order to stop the run (`finish`)      the run finishes
an order to follow a new source          not ``ended``; its end does not finish the run
the run finishes                         ``finishing``: no source; each robot stops by its policy
=======================================  ================================================================
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from contid.control.engine.cycle import OnEnd, Sink
from contid.control.engine.events.run import SourceEnded, StopBegan, StreamDelayed
from contid.control.engine.messages import RobotNames
from contid.control.engine.robots import Robots, Stopping
from contid.control.engine.sources import Live, Source, Timed
from contid.control.engine.stages import ArmsTogether
from contid.control.tick import transitions
from contid.control.tick.supervisor import Mode, stronger
from contid.control.tick.tip_feedback import Measurement
from contid.robot_file.base import StopPolicy
from contid.targets import Target
from contid.trajectory.timed import Trajectory

_NOTHING: Final[Mapping[str, Target | None]] = {}
#: Ticks between two looks at the delay of a live stream, and the part by which it changes in an event.
STATED_TICKS: Final = 50
STATED_SHARE: Final = 0.1


class TargetSelector:
    """The source of targets, and the end it comes to.

    Attributes:
        source: of the targets, None without one.
        attended: a client may give orders: the run does not end because every robot is in FAULT.
        ended: the source has ended.
        finishing: the run is ending; no motion begins.
    """

    def __init__(
        self,
        robots: Robots,
        chains: ArmsTogether,
        rate_hz: float,
        sink: Sink,
        *,
        trajectory: Trajectory | None,
        on_end: OnEnd,
        attended: bool,
    ) -> None:
        """Prepare; arguments as in `contid.control.engine.engine.Engine`."""
        self.source: Source | None = None
        if trajectory is not None:
            self.source = Timed(trajectory, rate_hz, robots.configs)
        self.attended = attended
        self.ended = False
        self.finishing = False
        self._end = Stopping(None, "on_end")
        self._robots = robots
        self._chains = chains
        self._rate_hz = rate_hz
        self._sink = sink
        self._on_end = on_end
        self._stated_s = 0.0  # delay of a live stream in its newest event

    def targets(self, step: int, now_s: float, skipped_s: float) -> Mapping[str, Target | None]:
        """Targets of a step by robot; keeps the measured tips of a trajectory.

        Args:
            step: ticks that ran.
            now_s: their time.
            skipped_s: the time of those that were skipped so far.
        """
        source = self.source
        if source is None:
            return _NOTHING
        if isinstance(source, Live):
            return source.targets(now_s, skipped_s, self._robots.states, self._robots.ask)
        targets = source.targets(step)
        self._note(targets, now_s)
        return targets

    def rows(self, targets: Mapping[str, Target | None], now_s: float, skipped_s: float) -> None:
        """A row of a live stream arrived; times as of `targets`."""
        with self._robots.costs.watched:
            self._live().put(targets, now_s, skipped_s, self._robots.states, self._robots.ask)
        self._note(targets, now_s)

    def end_of_rows(self) -> None:
        """No further row will come."""
        self._live().end()

    def _live(self) -> Live:
        """The live stream; the first row begins one."""
        if not isinstance(self.source, Live):
            self.source = Live(self._robots.configs)
        return self.source

    def play(self, trajectory: Trajectory, now_s: float, waits: bool = False) -> None:
        """Follow a trajectory instead; one that waits begins with `go`."""
        self._replace(Timed(trajectory, self._rate_hz, self._robots.configs, waits), now_s)

    @property
    def at_start(self) -> bool:
        """True when a trajectory waits, with every robot at its first row."""
        source = self.source
        return isinstance(source, Timed) and source.at_start(self._robots.states)

    def go(self) -> None:
        """Let a trajectory that waits begin in this step."""
        if isinstance(self.source, Timed):
            self.source.waits = False

    def begin_rows(self, now_s: float) -> None:
        """Follow a new live stream instead."""
        self._replace(Live(self._robots.configs), now_s)

    def pause(self, who: RobotNames, step: int) -> None:
        """Stop the time of the trajectory when all robots stop."""
        if who is None and self.source is not None:
            self.source.pause(step)

    def resume(self, who: RobotNames) -> None:
        """Resume the trajectory when all robots resume."""
        if who is None and self.source is not None:
            self.source.resume()

    def watch(self, tick: int, step: int, now_s: float) -> None:
        """After a tick, at the time of the next: end the run with its source, or with its last robot."""
        if self.finishing:
            self._rest_faulted()
            return
        source = self.source
        if isinstance(source, Live) and tick % STATED_TICKS == 0:
            self._report_delay(source.delay_s, tick)
        if source is not None:
            source.watch(step, self._robots.states, self.attended)
            if source.finished and not self.ended:
                self._end_with_source(tick, now_s)
        if self.attended or self.finishing:
            return
        if all(state.mode is Mode.FAULT for state in self._robots.states):
            self.finish(None, "on_fault", now_s)

    def _end_with_source(self, tick: int, now_s: float) -> None:
        self.ended = True
        self._sink.event(SourceEnded(tick=tick, on_end=self._on_end.value))
        if self._on_end is not OnEnd.HOLD:
            rest = StopPolicy.REST if self._on_end is OnEnd.REST else None
            self.finish(rest, "on_end", now_s)

    def _report_delay(self, delay_s: float, tick: int) -> None:
        """Emit the delay of a stream where it changed by more than a part."""
        if abs(delay_s - self._stated_s) > STATED_SHARE * max(delay_s, self._stated_s):
            self._stated_s = delay_s
            self._sink.event(StreamDelayed(tick=tick, delay_ms=round(1e3 * delay_s, 1)))

    def finish(self, policy: StopPolicy | None, reason: str, now_s: float) -> None:
        """Stop every robot; the run is over when all of them rest."""
        self.finishing, self.source = True, None
        self._end = Stopping(policy, reason)
        states = self._robots.states
        for index, state in enumerate(states):
            if state.mode not in (Mode.OFF, Mode.FAULT):
                self._robots.change(index, self._end, now_s)
        self._rest_faulted()
        self._chains.stopped(None, now_s)
        motions = [state.motion for state in states if state.mode in (Mode.STOPPING, Mode.FAULT)]
        seconds = max((motion.duration_s for motion in motions if motion is not None), default=0.0)
        self._sink.event(StopBegan(reason=reason, seconds=seconds))

    def _rest_faulted(self) -> None:
        """Bring the devices of robots that stand in FAULT to rest: by ``on_fault``, or what ends the run."""
        states = self._robots.states
        for index, (config, state) in enumerate(zip(self._robots.configs, states, strict=True)):
            if state.mode is Mode.FAULT and state.enabled and not any(state.increments):
                policy = stronger(config.stops.on_fault, self._end.policy_of(config))
                states[index] = transitions.bring_to_rest(state, stronger(policy, state.policy))

    def _note(self, targets: Mapping[str, Target | None], now_s: float) -> None:
        for robot, target in targets.items():
            if target is not None and target.measured_tip_m is not None:
                tip_m, direction = target.measured_tip_m, target.measured_direction
                self._robots.measured[robot] = Measurement(tip_m, now_s, direction)

    def _replace(self, source: Source, now_s: float) -> None:
        """Change the source: robots that followed the old one approach the new one, or hold."""
        self.source, self.ended, self._on_end = source, False, OnEnd.HOLD
        for index, state in enumerate(self._robots.states):
            if state.mode is Mode.RUN or (state.mode is Mode.APPROACH and state.goto is None):
                self._robots.change(index, transitions.stay, now_s)
