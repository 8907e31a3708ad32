"""Motion of an emulated servo: a trapezoidal profile towards a goal, a current, and hard stops.

Simplified to what the driver and homing depend on: finite speed, standstill at a stop while the current rises
to its limit, and an overload after pushing too hard for too long. The position loop closes over the encoder,
so one that is wrong leads the shaft elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from contid_drivers.dynamixel import registers as reg

#: No-load speed at 5 V, 103 rpm [ticks/s], and the acceleration of a free servo without a profile.
SPEED_MAX: Final = 103.0 / 60.0 * reg.TICKS_PER_REV
ACCELERATION_MAX: Final = 200_000.0
#: Ticks per second and tick of error near the goal, after the profile.
STIFFNESS: Final = 60.0
#: From an error and a way per step below this on, the shaft is on its goal [ticks].
ARRIVED_TICKS: Final = 0.5
#: Current that turns the shaft without a load, and that is added per tick of error at standstill.
FRICTION_MA: Final = 40.0
MA_PER_TICK: Final = 8.0
#: Pushing with more than this current against a stop for this time is an overload.
OVERLOAD_MA: Final = 900.0
OVERLOAD_S: Final = 0.5
#: Motor under a PWM: response of its speed, share of full PWM that just moves it, current at standstill.
TIME_CONSTANT_S: Final = 0.03
FRICTION_SHARE: Final = 0.04
STALL_MA: Final = 1470.0


class ShaftMotion:
    """Shaft of a servo; positions in ticks over all turns, currents in mA."""

    def __init__(self, position: float, stops: tuple[float, float]) -> None:
        self.position = self.goal = position
        self.stops = stops
        self.velocity = 0.0
        self.current = 0.0
        #: The encoder sees this share of the motion since ``_since``, and ``jumped`` more [ticks].
        self._share, self._since, self.jumped = 1.0, 0.0, 0.0
        #: Share of its top speed that it has left.
        self.slowed = 1.0
        self._speed = SPEED_MAX
        self._acceleration = ACCELERATION_MAX
        self._current_limit = float(reg.CURRENT_LIMIT.default)
        self._pushed_s = 0.0
        #: Current with which a tendon turns the shaft back, signed like its rotation [mA]; None for no load.
        self.load: Callable[[], float] | None = None

    def limit(self, speed: float, acceleration: float, current: float) -> None:
        """Limits of the profile [ticks/s, ticks/s^2; 0 is none] and of the current [mA]."""
        self._speed = min(speed, SPEED_MAX * self.slowed)
        self._acceleration = min(acceleration, ACCELERATION_MAX) if acceleration else ACCELERATION_MAX
        self._current_limit = current

    @property
    def seen(self) -> float:
        """Position by the encoder [ticks]."""
        return self._seen(self.position)

    def _seen(self, position: float) -> float:
        return self._since + self._share * (position - self._since) + self.jumped

    def see(self, share: float) -> None:
        """Let the encoder see a share of the motion from now on; 1 makes it a sound one."""
        self._share, self._since = share, self.position

    def release(self) -> None:
        """Torque off: the shaft stays where it is (a self-locking load)."""
        self.velocity = self.current = self._pushed_s = 0.0
        self.goal = self.seen

    def turn(self, ticks: float) -> None:
        """Turn the free shaft from outside, as far as its stops."""
        self.position = max(self.stops[0], min(self.stops[1], self.position + ticks))
        self.goal = self.seen

    @property
    def overloaded(self) -> bool:
        """True once the overload time is over."""
        return self._pushed_s > OVERLOAD_S

    def pushing(self, error: float) -> float:
        """Current at standstill with an error of position [ticks]."""
        return math.copysign(min(self._current_limit, FRICTION_MA + MA_PER_TICK * abs(error)), error)

    def step(self, dt: float) -> None:
        """Advance by ``dt`` [s] under torque.

        Against a load that turns the shaft away from its goal the motor needs the current of the load and
        that of the friction. Where the limit is not above both, the shaft stands still, with the current at
        its limit.
        """
        error = self.goal - self.seen
        load = self.load() if self.load is not None else 0.0
        if error == 0.0 and self.velocity == 0.0:
            self._hold(load)
            self._pushed_s = 0.0
            return
        opposing = abs(load) if load * error < 0.0 else 0.0
        blocked = opposing > 0.0 and FRICTION_MA + opposing >= self._current_limit
        self._accelerate(error, blocked, dt)
        ahead = self.position + self.velocity * dt
        position = max(self.stops[0], min(self.stops[1], ahead))
        at_stop = position != ahead
        if at_stop:
            self._push(position, dt)
        else:
            self._pushed_s = 0.0
            needed = self._current_limit if blocked else FRICTION_MA + opposing
            direction = error if blocked else self.velocity
            self.current = math.copysign(min(self._current_limit, needed), direction)
        close = abs(error) < ARRIVED_TICKS and abs(self.velocity) * dt < ARRIVED_TICKS
        if close and not blocked and not at_stop:
            # Exactly on the goal where the encoder sees the whole motion: it sees the position plus its jump.
            position = self.goal - self.jumped if self._share == 1.0 else position
            self.velocity = 0.0
            self._hold(load)
        self.position = position

    def _hold(self, load: float) -> None:
        """Standing on the goal: the current carries the load."""
        self.current = -load if load else 0.0

    def _accelerate(self, error: float, blocked: bool, dt: float) -> None:
        """Change the velocity towards the one that the profile has at this distance from the goal.

        It is the least of four: the speed of the profile, the one from which it can stop at the goal, the one
        of the position loop near the goal, and the one that reaches the goal within this step.
        """
        target = min(
            self._speed,
            math.sqrt(2.0 * self._acceleration * abs(error)),
            STIFFNESS * abs(error),
            abs(error) / dt,
        )
        target = math.copysign(target, error)
        if self._current_limit < FRICTION_MA:
            target = 0.0
        if blocked:
            self.velocity = target = 0.0
        change = self._acceleration * dt
        self.velocity += max(-change, min(change, target - self.velocity))

    def _push(self, stop: float, dt: float) -> None:
        """Stand still at a stop, with the current of the position loop; counts the time of an overload."""
        self.velocity = 0.0
        self.current = self.pushing(self.goal - self._seen(stop))
        self._pushed_s = self._pushed_s + dt if abs(self.current) > OVERLOAD_MA else 0.0

    def drive(self, share: float, supply: float, dt: float) -> None:
        """Advance by ``dt`` [s] under a PWM.

        The motion is the solution of

            T v' = u - v,   x' = v,   u = share top - hold sign(v),   top = supply slowed SPEED_MAX

        with the time constant T and the part ``hold`` of the friction:

            v(dt) = u + (v(0) - u) exp(-dt / T),   x(dt) = x(0) + u dt + (v(0) - u) T (1 - exp(-dt / T))

        The friction changes its sign at standstill, so a shaft whose velocity would change its sign stops in
        this step; its way is then that of a velocity that falls to 0 evenly over the step.

        Args:
            share: share of full PWM, signed like the rotation.
            supply: voltage of the supply as a share of the one at which `SPEED_MAX` holds.
            dt: the time.
        """
        top = supply * self.slowed * SPEED_MAX
        hold = FRICTION_SHARE * top
        standing = self.velocity == 0.0
        if standing and abs(share * top) <= hold:
            self.current = 0.0
            return
        target = share * top - math.copysign(hold, share if standing else self.velocity)
        kept = math.exp(-dt / TIME_CONSTANT_S)
        after = target + (self.velocity - target) * kept
        way = target * dt + (self.velocity - target) * TIME_CONSTANT_S * (1.0 - kept)
        if after * self.velocity < 0.0:
            after, way = 0.0, self.velocity * dt / 2.0
        ahead = self.position + way
        self.position = max(self.stops[0], min(self.stops[1], ahead))
        self.velocity = after if self.position == ahead else 0.0
        self.goal = self.position
        self.current = (share * supply - self.velocity / SPEED_MAX) * STALL_MA
