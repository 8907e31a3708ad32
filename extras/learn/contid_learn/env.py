"""`TipEnv`: robots of a file, simulated, as a `gymnasium.Env` whose episodes run the control loop itself.

Approach, limits, jerk, watchdogs, faults and the delay of a live stream are those of ``contid run``: an
action becomes a row of such a stream, and the rows of `contid_learn.views` are what the policy will send.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final, TypeAlias

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from contid import Robot, Sim
from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.robot_file.load import LoadedFile
from contid_learn.randomised import Intervals, checked, drawn, varied, with_bodies
from contid_learn.tasks import GoalPath, Task, drawn_paths
from contid_learn.views import BOUND, Observation, Seen, TipGoal, asked_after, observation, row_of, views_of
from contid_library.sim_state import SimRobot, SimState

#: Share of the size of a robot within which a tip has arrived.
ARRIVED_SHARE: Final = 0.02
#: When a load is put on the tip in the task ``hold`` [s], and its mass [g], where no interval is given.
HELD: Final = {"payload_at_s": (0.5, 1.5), "payload_g": (0.0, 2.0)}

Action: TypeAlias = NDArray[np.float32]
Info: TypeAlias = dict[str, Any]


class TipEnv(gymnasium.Env[Observation, Action]):
    """Tips of the robots of a file, to be moved.

    The reward of a step is minus the distance of the tip from its goal, as a share of the size of the robot,
    the mean of all robots. An episode ends early with a fault; every step that is left then costs 1.

    Args:
        robot: a robot file, or the name of a shipped one; its devices are simulated.
        task: ``reach``, ``follow`` or ``hold`` (`contid_learn.tasks.Task`).
        rate_hz: actions per second; rounded so that a whole number of ticks lies between two.
        episode_s: after which an episode is truncated.
        moving: bodies have masses and damping (`dynamics` of the robot file), and a tracker sees the tip.
        randomise: an interval by key of `contid_learn.randomised`, from which every episode draws.

    Attributes:
        sim: the simulation; `close` ends it.
        views: the robots, as a policy sees them.
        rate_hz: actions per second.

    Raises:
        ContidError: no such file, task or key; ``hold`` or ``moving`` with a robot that has no body.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  # as gymnasium declares it

    def __init__(
        self,
        robot: str | Path = "finger",
        *,
        task: str = "reach",
        rate_hz: float = 20.0,
        episode_s: float = 3.0,
        moving: bool = False,
        randomise: Intervals | None = None,
    ) -> None:
        if task not in [*Task]:
            raise ContidError(f"task {task!r}: allowed: {', '.join(Task)}")
        self.task = Task(task)
        self._intervals = checked(randomise or {})
        if self.task is Task.HOLD:
            self._intervals = {**HELD, **self._intervals}
        self._body = moving or self.task is Task.HOLD
        self._moving = moving
        self.sim = Sim(robot)
        if not 0.0 < rate_hz <= self.sim.rate_hz:
            raise ContidError(
                f"rate_hz={rate_hz:g}: allowed: above 0, up to that of the tick, {self.sim.rate_hz:g}"
            )
        self.ticks = max(1, round(self.sim.rate_hz / rate_hz))
        self.rate_hz = self.sim.rate_hz / self.ticks
        self.views = views_of(Robot(robot), self.rate_hz)
        self._length = max(1, round(episode_s * self.rate_hz))
        width, axes = sum(view.width for view in self.views), sum(len(view.columns) for view in self.views)
        self.observation_space = spaces.Box(-BOUND, BOUND, (width,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (axes,), np.float32)
        self._paths: dict[str, GoalPath] = {}
        self._asked: dict[str, Array] = {}
        self._steps = 0
        self.sim.reset(variant=self._variant({key: low for key, (low, _) in self._intervals.items()}))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, Info]:
        """Begin an episode: robots armed at their start, new goals, new noise, new numbers drawn."""
        super().reset(seed=seed)
        numbers = drawn(self._intervals, self.np_random)
        noise = int(self.np_random.integers(2**31))
        state = self.sim.reset(noise, variant=self._variant(numbers))
        self._paths = drawn_paths(self.task, self.views, self.np_random)
        self._steps = 0
        seen = self._seen(state)
        self._asked = {view.name: view.begin(seen[view.name].measured) for view in self.views}
        goals = self._goals()
        return observation(self.views, seen, self._asked, goals), self._info(state, seen, goals)

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, Info]:
        """Send the row of an action, and run the ticks until the next one."""
        before = self._asked
        self._asked = asked_after(self.views, before, np.asarray(action, dtype=np.float64))
        state = self.sim.step(row_of(self.views, self._asked), ticks=self.ticks)
        if any(robot.refused for robot in state.robots.values()):
            self._asked = before
        self._steps += 1
        seen, goals = self._seen(state), self._goals()
        info = self._info(state, seen, goals)
        faulty = any(info["faults"].values())
        shares = [info["distance"][view.name] / view.size for view in self.views]
        reward = -sum(shares) / len(shares)
        if faulty:
            reward -= self._length - self._steps
        truncated = self._steps >= self._length
        return observation(self.views, seen, self._asked, goals), reward, faulty, truncated, info

    def close(self) -> None:
        """End the simulation. Idempotent."""
        self.sim.close()

    def _goals(self) -> dict[str, TipGoal]:
        time_s = self._steps / self.rate_hz
        return {name: path.at(time_s) for name, path in self._paths.items()}

    def _seen(self, state: SimState) -> dict[str, Seen]:
        return {view.name: _seen(state[view.name], len(view.columns)) for view in self.views}

    def _info(self, state: SimState, seen: dict[str, Seen], goals: dict[str, TipGoal]) -> Info:
        distance = {view.name: view.distance(seen[view.name], goals[view.name]) for view in self.views}
        return {
            "distance": distance,
            "is_success": all(distance[view.name] <= ARRIVED_SHARE * view.size for view in self.views),
            "modes": {name: robot.mode for name, robot in state.robots.items()},
            "faults": {name: robot.fault for name, robot in state.robots.items()},
            "refused": {name: robot.refused for name, robot in state.robots.items() if robot.refused},
            "goals": {name: goal.tip for name, goal in goals.items()},
        }

    def _variant(self, numbers: dict[str, float]) -> Any:
        def change(loaded: LoadedFile) -> LoadedFile:
            bodies = with_bodies(loaded, self._moving) if self._body else loaded
            return varied(bodies, numbers)

        return change


def _seen(robot: SimRobot, axes: int) -> Seen:
    """What a policy may see of a robot: what a tracker saw of its tip, else its model."""
    tip = robot.tracked if math.isfinite(robot.tracked.sum()) else robot.tip
    return Seen(robot.measured[:axes], tip)
