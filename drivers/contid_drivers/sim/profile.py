"""Trapezoidal profile and first-order response, both in closed form.

The profile r(t) is the time-optimal motion to rest under ``|r'| <= v_max`` and ``|r''| <= a_max`` from any
start position and velocity: at most four phases of constant acceleration. The device follows it as

    tau x' = r - x

whose solution over a phase ``r = r0 + v t + a t^2 / 2`` is, with the particular part
``p(t) = r - tau r' + tau^2 r''``,

    x(t) = p(t) + (x(0) - p(0)) exp(-t / tau).

So a long step equals many short ones up to rounding: simulated devices do not depend on the tick rate.
Units are those of the device: rad or Pa, and their derivatives by s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple


class ProfileState(NamedTuple):
    """Position [rad or Pa] and velocity."""

    position: float
    velocity: float


@dataclass(frozen=True, slots=True)
class Phase:
    """Constant acceleration from ``start_s`` until the next phase; values in rad or Pa, and per s and s^2."""

    start_s: float
    position: float
    velocity: float
    acceleration: float

    def at(self, t_s: float) -> ProfileState:
        """The state at a time inside the phase."""
        dt = t_s - self.start_s
        return ProfileState(
            self.position + dt * (self.velocity + 0.5 * dt * self.acceleration),
            self.velocity + dt * self.acceleration,
        )


def plan(
    t_s: float, position: float, velocity: float, goal: float, v_max: float, a_max: float
) -> tuple[Phase, ...]:
    """Fastest motion from ``(position, velocity)`` to rest at ``goal``; the last phase rests there.

    Either limit may be infinite: without ``a_max`` the speed jumps, without both the goal is reached at once.
    """
    distance = goal - position
    if math.isinf(a_max):
        duration = 0.0 if math.isinf(v_max) else abs(distance) / v_max
        if duration == 0.0:
            return (Phase(t_s, goal, 0.0, 0.0),)
        cruise = Phase(t_s, position, math.copysign(v_max, distance), 0.0)
        return (cruise, Phase(t_s + duration, goal, 0.0, 0.0))

    # Seen in the direction in which braking now would still fall short of the goal.
    sign = 1.0 if distance >= velocity * abs(velocity) / (2.0 * a_max) else -1.0
    length, speed = sign * distance, sign * velocity
    top = min(v_max, math.sqrt(max(0.0, a_max * length + 0.5 * speed * speed)))
    ramp = math.copysign(a_max, top - speed)
    ramp_length = (top * top - speed * speed) / (2.0 * ramp)
    cruise_length = max(0.0, length - ramp_length - top * top / (2.0 * a_max))
    durations = (
        (abs(top - speed) / a_max, ramp),
        (cruise_length / top if top > 0.0 else 0.0, 0.0),
        (top / a_max, -a_max),
    )
    phases = []
    for duration, acceleration in durations:
        if duration <= 0.0:
            continue
        phase = Phase(t_s, position, velocity, sign * acceleration)
        phases.append(phase)
        t_s += duration
        position, velocity = phase.at(t_s)
    return (*phases, Phase(t_s, goal, 0.0, 0.0))


#: Share of the top speed that a moving goal has at most: the rest is for catching up with it.
_GOAL_SHARE: Final = 63.0 / 64.0


@dataclass(frozen=True, slots=True)
class MovingGoal:
    """A goal on a straight line: where it is now, its velocity, and when it stands, where it is now.

    The set-point of a motor board follows a stream in this way (``firmware/contid_due/src/core/setpoint.h``).
    """

    position: float
    velocity: float
    until_s: float


def plan_to_moving(
    t_s: float, position: float, velocity: float, goal: MovingGoal, v_max: float, a_max: float
) -> tuple[Phase, ...]:
    """Fastest motion that meets a moving goal, goes with it, and comes to rest once it stands.

    Seen from the goal it is a motion to rest, with what is left of the top speed in its direction.
    """
    drift = min(max(goal.velocity, -_GOAL_SHARE * v_max), _GOAL_SHARE * v_max)
    distance, speed = goal.position - position, velocity - drift
    ahead = distance >= speed * abs(speed) / (2.0 * a_max)
    seen = plan(t_s, -distance, speed, 0.0, v_max - drift if ahead else v_max + drift, a_max)
    phases = [
        Phase(
            each.start_s,
            goal.position + drift * (each.start_s - t_s) + each.position,
            each.velocity + drift,
            each.acceleration,
        )
        for each in seen
        if each.start_s < goal.until_s
    ]
    end = phases[-1].at(goal.until_s)
    return (*phases, *plan(goal.until_s, *end, goal.position, v_max, a_max))


class ProfileMotion:
    """State of one simulated actuator: its profile and its own position."""

    __slots__ = ("_phases", "_seen", "blocked", "tau_s", "time_s", "value")

    def __init__(self, time_s: float, value: float, tau_s: float) -> None:
        self.time_s = time_s
        self.value = value
        self.tau_s = tau_s
        #: True while the shaft is blocked: the profile continues, the value does not.
        self.blocked = False
        self._phases: tuple[Phase, ...] = (Phase(time_s, value, 0.0, 0.0),)
        #: The state of the profile now, once it was asked for: a tick looks at it six times.
        self._seen: ProfileState | None = None

    @property
    def reference(self) -> ProfileState:
        """The state of the profile now."""
        if self._seen is None:
            self._seen = self._phases[0].at(self.time_s)
        return self._seen

    @property
    def velocity(self) -> float:
        """Velocity of the device itself."""
        if self.blocked:
            return 0.0
        position, velocity = self.reference
        return (position - self.value) / self.tau_s if self.tau_s > 0.0 else velocity

    def go(self, goal: float, v_max: float, a_max: float) -> None:
        """Go to a goal from the present state of the profile, without a jump of its velocity."""
        position, velocity = self.reference
        self._begin(plan(self.time_s, position, velocity, goal, v_max, a_max))

    def go_with(self, goal: MovingGoal, v_max: float, a_max: float) -> None:
        """Go to a moving goal, likewise."""
        self._begin(plan_to_moving(self.time_s, *self.reference, goal, v_max, a_max))

    def stop(self) -> None:
        """End the profile where it is; the value follows with its response."""
        self._begin((Phase(self.time_s, self.reference.position, 0.0, 0.0),))

    def freeze(self) -> None:
        """Stop at the present value."""
        self._begin((Phase(self.time_s, self.value, 0.0, 0.0),))

    def _begin(self, phases: tuple[Phase, ...]) -> None:
        self._phases, self._seen = phases, None

    def advance(self, to_s: float) -> None:
        """Advance to a later time; an earlier one changes nothing."""
        while self.time_s < to_s:
            self._drop_past()
            phases = self._phases
            phase = phases[0]
            end_s = min(to_s, phases[1].start_s) if len(phases) > 1 else to_s
            after = phase.at(end_s)
            if not self.blocked:
                self.value = self._response(phase, end_s, after)
            self.time_s, self._seen = end_s, after
        self._drop_past()

    def _drop_past(self) -> None:
        """Leave out phases that ended."""
        while len(self._phases) > 1 and self._phases[1].start_s <= self.time_s:
            self._begin(self._phases[1:])

    def _response(self, phase: Phase, end_s: float, after: ProfileState) -> float:
        """The value at the end of a part of a phase, where the profile is ``after``."""
        tau = self.tau_s
        r1, v1 = after
        if tau <= 0.0:
            return r1
        bend = tau * tau * phase.acceleration
        r0, v0 = self.reference
        decay = math.exp(-(end_s - self.time_s) / tau)
        return r1 - tau * v1 + bend + (self.value - (r0 - tau * v0 + bend)) * decay
