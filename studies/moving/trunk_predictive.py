"""Predictive control of a real trunk's twin: a program in every tick, beside the shaped and the led path.

    python -m studies.moving.trunk_predictive

Packages apart from contid's: ``piqp``, and ``osqp`` for a comparison of times. Twins and motions are those of
the study `trunk_control`. A tick of the predictive control:

1. states of the models (lag, place, velocity in two directions) are carried over the dead time by the
   commands that are on their way;
2. a quadratic program finds the places at rest, linear between knots over the next 0.55 s, that bring the
   models to the path: position, speed and acceleration of every motor are constraints, linear about now;
3. the tick's part of the first knot goes to the motors, whose limits hold in any case.

Bounded work: at most `ITERATIONS` of an interior point method. A program that is not solved by them, or not
finite, sends the motors to the path itself in the same tick, by their own profile. The path is changed by
what was learnt from the measured tips (`Feedback` of `trunk_control`).

The ARX baseline is what a lab without a model does: linear ARX of order 6 at 50 ms, fitted to the recording
with 0 g, the last tips measured, the same solver, box constraints on the angles and their steps.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from studies.moving.recordings import PERIOD_S
from studies.moving.trunk_arx import steered_by_arx
from studies.moving.trunk_control import LAPS, NOISE_MM, Feedback, eight
from studies.moving.trunk_program import ITERATIONS, PredictiveRun, Program, cost, of_jump
from studies.moving.trunk_twin import (
    ACCELERATION,
    DELAY,
    LIMIT_DEG,
    SPEED,
    Motors,
    MovingTrunk,
    TrunkMode,
    fitted,
)

#: Ticks of the knots, and of the horizon.
KNOTS: Final = (3, 6, 10, 15, 21, 28, 36, 45, 55)
HORIZON: Final = 55


@dataclass(frozen=True)
class Wish:
    """What a program is to reach.

    Attributes:
        shares: frequencies of its models. For a path that of the model; for a jump also lower ones, because
            too low a frequency leaves less swing than too high a one.
        smooth: weight of a change of slope between knots [s^2], beside 1 of an error.
        early, first: the first errors of the horizon count this much: rest behind a jump is worth more than
            its first half.
    """

    shares: tuple[float, ...]
    smooth: float
    early: int
    first: float


PATH: Final = Wish((1.0,), 1e-7, 0, 1.0)
JUMP: Final = Wish((0.8, 0.92, 1.04), 1e-5, 36, 0.01)
#: Frequencies of the twins, as shares.
TWINS: Final = (0.8, 1.0, 1.2)


class Predictive:
    """Commands for a path known ahead; see the module."""

    def __init__(self, model: MovingTrunk, motors: Motors, wish: Wish) -> None:
        self._model, self.motors, self._wish = model, motors, wish
        modes = [replace(model.mode, hz=share * model.mode.hz) for share in wish.shares]
        self._steps = [mode.step() for mode in modes]
        count = len(KNOTS)
        self._knots = np.array((0, *KNOTS))
        spread = np.array([np.interp(np.arange(1.0, HORIZON + 1.0), self._knots, row)
                           for row in np.eye(count + 1)]).T  # fmt: skip
        self._first, self._rest = spread[:, 0], spread[:, 1:]
        # Tips of the horizon by the state at its begin and by the places at its ticks.
        self._free, self._forced = [], []
        for a, b in self._steps:
            power, free, answer = np.eye(3), [], []
            for _ in range(HORIZON):
                answer.append((power @ b)[1])
                power = a @ power
                free.append(power[1])
            forced = np.array([[answer[i - j] if j <= i else 0.0 for j in range(HORIZON)]
                               for i in range(HORIZON)])  # fmt: skip
            self._free.append(np.array(free))
            self._forced.append(forced)
        self._weight = np.where(np.arange(HORIZON) < wish.early, wish.first, 1.0) / len(wish.shares)
        gaps = np.diff(self._knots) * PERIOD_S
        slopes = (np.eye(count + 1)[1:] - np.eye(count + 1)[:-1]) / gaps[:, None]
        self._turns = np.vstack((slopes[0], np.diff(slopes, axis=0)))[:, 1:]
        self._slopes, self._gaps = slopes[:, 1:], gaps
        quadratic = HORIZON * wish.smooth * self._turns.T @ self._turns
        for forced in self._forced:
            x = forced @ self._rest
            quadratic = quadratic + x.T @ (self._weight[:, None] * x)
        self.program = Program(np.kron(quadratic, np.eye(2)) + 1e-6 * np.eye(2 * count))
        rest = model.still(motors.angles[None, :])[0]
        self.states = [np.vstack((rest, rest, np.zeros(2))) for _ in wish.shares]
        self._last = rest
        self._way = np.zeros(2)
        self.fallbacks = 0

    def arrived(self, place: Array) -> None:
        """A place at rest that acts from now on: the states of one tick later, the dead time aside."""
        self.states = [a @ x + np.outer(b, place) for (a, b), x in zip(self._steps, self.states, strict=True)]

    def command(self, wished: Array, safe: Array) -> Array:
        """Angles of this tick.

        Args:
            wished: tips ``(HORIZON, 2)`` [mm] from the end of the dead time on.
            safe: where the motors go, braking for it, in a tick whose program is not solved.
        """
        angles = self.motors.angles
        linear = np.zeros((len(KNOTS), 2))
        # The first turn begins with the motors' way of the last tick; the first two hold the last place.
        slope = self._last / self._gaps[0]
        turn = np.outer(self._turns[1], slope) - np.outer(self._turns[0], slope + self._way)
        linear += HORIZON * self._wish.smooth * turn
        for free, forced, x in zip(self._free, self._forced, self.states, strict=True):
            left = free @ x + np.outer(forced @ self._first, self._last) - wished
            linear += (forced @ self._rest).T @ (self._weight[:, None] * left)
        rows, low, high = self._limits(angles)
        found = self.program.solved(linear.ravel(), rows, low, high)
        if found is None:
            self.fallbacks += 1
            sent = self.motors.towards(safe)
        else:
            place = self._last + (found[:2] - self._last) / KNOTS[0]
            sent = self.motors.follow(self.motors.wished(place))
        now = self._model.still(sent[None, :])[0]
        self._way, self._last = (now - self._last) / PERIOD_S, now
        self.arrived(now)
        return sent

    def _limits(self, angles: Array) -> tuple[Array, Array, Array]:
        """Rows of position, speed and acceleration of every motor over the knots."""
        rows = np.vstack((angles, angles + np.eye(6)))
        tips = self._model.still(rows)
        slope = (tips[1:] - tips[0]).T * LIMIT_DEG
        per_mm = LIMIT_DEG[:, None] * np.linalg.solve(slope @ slope.T + 1e-6 * np.eye(2), slope).T
        base = per_mm @ self._last
        ones = np.ones(len(KNOTS))
        place = np.kron(np.eye(len(KNOTS)), per_mm)
        low, high = (np.kron(ones, side * LIMIT_DEG - angles + base) for side in (-1.0, 1.0))
        speed = np.kron(self._slopes, per_mm)
        from_s = np.zeros(len(speed))
        from_s[:6] = base / self._gaps[0]
        turn = np.kron(self._turns, per_mm)
        from_t = np.zeros(len(turn))
        from_t[:6] = base / self._gaps[0] + per_mm @ self._way
        if len(KNOTS) > 1:
            from_t[6:12] = -base / self._gaps[0]
        most = np.kron(np.append(self._gaps[0], self._gaps[:-1]), np.full(6, ACCELERATION))
        return (
            np.vstack((place, speed, turn)),
            np.concatenate((low, from_s - SPEED, from_t - most)),
            np.concatenate((high, from_s + SPEED, from_t + most)),
        )


def steered(
    twin: MovingTrunk,
    model: MovingTrunk,
    path: Array,
    moves: bool,
    learns: bool,
    begin: Array,
    iterations: int = ITERATIONS,
) -> PredictiveRun:
    """Drive a twin along a path ``(ticks, 2)`` [mm].

    Args:
        twin: moves.
        model: commands.
        path: of the tip, known ahead where it ``moves``, else a jump.
        moves: see ``path``.
        learns: by feedback.
        begin: angles of the motors.
        iterations: of the solver, at most.
    """
    rng = np.random.default_rng(1)
    motors, found = Motors(model, begin), Feedback()
    control = Predictive(model, motors, PATH if moves else JUMP)
    control.program.limit(iterations)
    a, b = twin.mode.step()
    am, bm = model.mode.step()
    x = np.vstack((twin.still(begin[None, :]),) * 2 + (np.zeros((1, 2)),))
    xm = np.vstack((model.still(begin[None, :]),) * 2 + (np.zeros((1, 2)),))
    ahead = np.vstack((path, np.repeat(path[-1:], HORIZON + DELAY + 1, axis=0)))
    velocity = np.gradient(ahead, PERIOD_S, axis=0) if moves else np.zeros_like(ahead)
    queue = [begin] * DELAY
    tips, angles, costs = [], [], []
    for k in range(len(path)):
        begun = time.process_time()
        if learns:
            found.measured(x[1] + rng.normal(0.0, NOISE_MM, 2), xm[1], xm[2])
        # A path is known ahead, a jump is not.
        own = k + DELAY + np.arange(1, HORIZON + 1) if moves else np.full(HORIZON, k)
        wished = found.asked(ahead[own], velocity[own]) if learns else ahead[own]
        sent = control.command(wished, wished[0])
        costs.append(time.process_time() - begun)
        queue.append(sent)
        late = queue.pop(0)[None, :]
        xm = am @ xm + np.outer(bm, model.still(late)[0])
        x = a @ x + np.outer(b, twin.still(late)[0])
        tips.append(x[1])
        angles.append(sent)
    return PredictiveRun(
        np.array(tips), np.array(angles), np.array(costs), control.fallbacks, np.array(control.program.costs)
    )


class RecordedPrograms:
    """Stands in for a solver and keeps its programs."""

    def __init__(self, program: Program) -> None:
        self.programs: list[tuple[Array, Array, Array, Array]] = []
        self.costs: list[float] = []
        self._program = program

    def solved(self, linear: Array, rows: Array, low: Array, high: Array) -> Array | None:
        """Keeps a program and has it solved."""
        self.programs.append((linear, rows, low, high))
        found = self._program.solved(linear, rows, low, high)
        self.costs = self._program.costs
        return found


def solvers(model: MovingTrunk, begin: Array) -> Iterator[str]:
    """Times of two solvers on the programs of a jump, and how far apart their first knots are."""
    import osqp
    from scipy import sparse

    control = Predictive(model, Motors(model, begin), JUMP)
    kept = RecordedPrograms(control.program)
    control.program = kept  # type: ignore[assignment]
    ours = []
    for _ in range(100):
        control.command(np.tile(np.array([50.0, 0.0]), (HORIZON, 1)), np.zeros(2))
    program = kept._program
    _, rows, low, high = kept.programs[0]
    other = osqp.OSQP()
    # A full pattern: the rows of a tick differ in values only.
    full = sparse.csc_matrix(np.where(rows == 0.0, 1e-12, rows))
    other.setup(
        sparse.csc_matrix(np.triu(program.quadratic)), kept.programs[0][0], full, low, high,
        verbose=False, eps_abs=1e-3, eps_rel=1e-3, max_iter=4000,
    )  # fmt: skip
    times, apart, failed = [], [], 0
    for linear, rows, low, high in kept.programs:
        ours.append(program.solved(linear, rows, low, high))
        begun = time.process_time()
        other.update(q=linear, Ax=np.where(rows == 0.0, 1e-12, rows).T.ravel(), l=low, u=high)
        found = other.solve()
        times.append(time.process_time() - begun)
        failed += found.info.status != "solved"
        if ours[-1] is not None:
            apart.append(float(np.linalg.norm(found.x[:2] - ours[-1][:2])))
    for name, costs in (("PIQP", program.costs[-100:]), ("OSQP", times)):
        yield (
            f"{name}: {1e3 * np.median(costs):.2f} ms, p99 {1e3 * np.percentile(costs, 99):.2f} ms, greatest "
            f"{1e3 * np.max(costs):.2f} ms of processor"
        )
    yield f"OSQP unsolved {failed} of 100; first knots apart by {np.max(apart):.3f} mm at most"


def report() -> Iterator[str]:
    """All tables."""
    model = fitted(0)
    loads = {0: model, **{grams: fitted(grams, (model.delay,), (model.mode,)) for grams in (100, 300)}}
    twins = {
        (grams, share): replace(load, mode=TrunkMode(load.mode.lag_s, share * load.mode.hz))
        for grams, load in loads.items()
        for share in TWINS
    }
    begin = Motors(model, np.zeros(6)).wished(np.array([-50.0, 0.0]), 12)
    goal = np.tile(np.array([50.0, 0.0]), (250, 1))
    goal[:40] = model.still(begin[None, :])[0]
    path = eight(LAPS)
    yield from solvers(model, begin)
    run = steered(model, model, goal, moves=False, learns=False, begin=begin, iterations=2)
    yield f"jump, a solver that is ended after two iterations: {of_jump(run, model)}; {cost(run)}"
    for (grams, share), twin in twins.items():
        of = f"{grams} g, {share:g} f"
        run = steered(twin, model, goal, moves=False, learns=False, begin=begin)
        yield f"jump, predictive, {of}: {of_jump(run, twin)}; {cost(run)}"
        run = steered_by_arx(twin, model, goal, begin)
        yield f"jump, ARX, {of}: {of_jump(run, twin)}; {cost(run)}"
    for (grams, share), twin in twins.items():
        of = f"{grams} g, {share:g} f"
        for name, run in (
            ("predictive", steered(twin, model, path, moves=True, learns=False, begin=np.zeros(6))),
            ("predictive, learning", steered(twin, model, path, moves=True, learns=True, begin=np.zeros(6))),
            ("ARX", steered_by_arx(twin, model, path, np.zeros(6))),
        ):
            off = np.sqrt(np.mean(np.sum((run.tips - path) ** 2, axis=1).reshape(LAPS, -1), axis=1))
            yield (
                f"eight, {name}, {of}: rms by lap {', '.join(f'{each:.1f}' for each in off)} mm; {cost(run)}"
            )


if __name__ == "__main__":
    for line in report():
        print(line, flush=True)  # noqa: T201
