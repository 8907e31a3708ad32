"""Motion of an emulated servo: a trapezoidal profile towards a goal, a current, and hard stops.

Simplified to what the driver and homing depend on: finite speed, standstill at a stop while the current rises
to its limit, and an overload after pushing too hard for too long. The position loop closes over the encoder,
so one that is wrong leads the shaft elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

#: No-load speed at 5 V, 103 rpm [ticks/s], and the acceleration of a free servo without a profile.
SPEED_MAX: Final = 103.0 / 60.0 * 4096.0
ACCELERATION_MAX: Final = 200_000.0
#: Ticks per second and tick of error near the goal, after the profile.
STIFFNESS: Final = 60.0
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
        self._current_limit = 1750.0
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
        """Advance by ``dt`` [s] under torque."""
        error = self.goal - self.seen
        load = self.load() if self.load is not None else 0.0
        if error == 0.0 and self.velocity == 0.0:
            self.current = -load if load else 0.0  # what holds it
            self._pushed_s = 0.0
            return
        target = min(
            self._speed,
            math.sqrt(2.0 * self._acceleration * abs(error)),
            STIFFNESS * abs(error),
            abs(error) / dt,
        )
        target = math.copysign(target, error)
        if self._current_limit < FRICTION_MA:
            target = 0.0
        opposing = abs(load) if load * error < 0.0 else 0.0
        blocked = opposing > 0.0 and FRICTION_MA + opposing >= self._current_limit
        if blocked:
            self.velocity = target = 0.0
        change = self._acceleration * dt
        self.velocity += max(-change, min(change, target - self.velocity))
        moved = self.position + self.velocity * dt
        free = max(self.stops[0], min(self.stops[1], moved))
        if moved != free:
            self.velocity = 0.0
            self.current = self.pushing(self.goal - self._seen(free))
            self._pushed_s = self._pushed_s + dt if abs(self.current) > OVERLOAD_MA else 0.0
        else:
            self._pushed_s = 0.0
            needed = self._current_limit if blocked else FRICTION_MA + opposing
            self.current = math.copysign(
                min(self._current_limit, needed), error if blocked else self.velocity
            )
        if abs(error) < 0.5 and not blocked and moved == free and abs(self.velocity) * dt < 0.5:
            free = self.goal - self.jumped if self._share == 1.0 else free
            self.velocity, self.current = 0.0, -load if load else 0.0
        self.position = free

    def drive(self, share: float, supply: float, dt: float) -> None:
        """Advance by ``dt`` [s] under a share of full PWM, at a share of the supply of `SPEED_MAX`."""
        top = supply * SPEED_MAX
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
        self.position, moved = (
            max(self.stops[0], min(self.stops[1], self.position + way)),
            self.position + way,
        )
        self.velocity = after if self.position == moved else 0.0
        self.goal = self.position
        self.current = (share * supply - self.velocity / SPEED_MAX) * STALL_MA
