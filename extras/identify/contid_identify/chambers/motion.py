"""The tip of a pneumatic arm in motion: one arc per section, from set-points of its chambers.

    x_j      set-point j, late, behind two stages in series that fill and vent at different speeds
    F        sum over the chambers of a section of x_j, those that only lengthen it with a weight
    u        s + a c F + (1 - a) P(c F)            P: play of half a width r (friction of the sleeve)
    length   u where it is far below the longest length, and never above that one
    bend     g sum x_j e_j + h (the same of sections above), at most (longest - length) / d:
             the side of a section that is blown up does not get longer than the whole of it can

Nine numbers per section and five times describe an arm, so that patterns of set-points that were not recorded
follow from those that were. Where the play stands when a recording begins, and the bends then, are
found from its first tips (`ChamberMotion.zeroed`). Fitted by `contid_identify.chambers.fit`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid_identify.answer import between, checked_commands
from contid_identify.remembered import RememberedMotion
from contid_identify.sections.arcs import chained
from contid_identify.sections.play import played
from contid_identify.tip_motion import OLD_STEP_S, AheadError

#: Steps of the simulation [s] at most.
STEP_S: Final = 0.05
#: Sharpness with which a length meets the longest one, and a bend its bound.
_LENGTH_MEETS: Final = 16.0
_BEND_MEETS: Final = 6.0
#: Of the longest length: what a bend of a section that is as long as it can be is still free by.
_FREE: Final = 0.01
#: Times before, by whose inflations recordings differ [s].
_AGO_S: Final = (0.0, 0.5, 1.5)
INFLATIONS: Final = len(_AGO_S)
#: Tips until then show where a recording begins [s].
ZERO_S: Final = 0.2
#: What is expected of bends [rad] and of the play, as a share of its half width, at a beginning; tips [m].
_BENDS_RAD: Final = 0.1
_SHARE: Final = 0.5
_TIP_M: Final = 0.5e-3


@dataclass(frozen=True, eq=False)
class ChamberArm:
    """What is known of an arm without a recording.

    Attributes:
        section: of each chamber, ``(axes,)`` of int.
        directions: to which side each chamber bends its section, unit vectors ``(axes, 2)`` across the arm;
            zero for chambers that only lengthen it.
        length_m, link_m: of each section at rest, and of the rigid part behind it, ``(sections,)``.
    """

    section: NDArray[np.intp]
    directions: Array
    length_m: Array
    link_m: Array

    @property
    def sections(self) -> int:
        """Their number."""
        return len(self.length_m)


#: Numbers of a section, in the order of the columns of `ChamberMotion.numbers`.
NUMBERS: Final = (
    "straight_m", "grows_m", "longest_m", "others", "elastic", "play_m", "side_m", "bends_rad", "above_rad",
)  # fmt: skip


_LONGEST: Final = NUMBERS.index("longest_m")
_SIDE: Final = NUMBERS.index("side_m")


class _Arcs(NamedTuple):
    """Lengths ``(n,)`` [m] and bends ``(n, 2)`` [rad] of one section."""

    lengths: Array
    bends: Array


@dataclass(frozen=True, eq=False)
class Beginning:
    """An arm when a recording begins.

    Attributes:
        bends: of the sections ``(sections, 2)`` [rad].
        share: where the play of all sections stands, from -1 (never inflated) to 1 (just vented).
        offset_m: of the tip from that of the arcs, ``(3,)``.
    """

    bends: Array
    share: float
    offset_m: Array


@dataclass(frozen=True, eq=False)
class ChamberMotion:
    """The tip of one pneumatic arm in motion.

    Attributes:
        robot: its name.
        axes: names of its chambers.
        arm: sections and chambers.
        rest_pa, span_pa: least set-point of the recordings, and from there to the greatest.
        times_s: dead time, filling and venting of the first stage, then of the second one, ``(5,)``.
        numbers: of each section ``(sections, 9)``, see `NUMBERS`: length at rest in the middle of the play,
            growth by one chamber, longest length, weight of the chambers that only lengthen, share of the
            growth without play, half width of the play, distance of the sides from the axis, bend by one
            chamber, and bend by those of sections above.
        begins: as the recordings began, in the mean.
        high: greatest ``x`` of the recordings per chamber, ``(axes,)``.
        memory, memory_step_s, errors, source, remembered: as in `contid_identify.tip_motion.TipMotion`.
        apart: recordings each of which a fit to others predicted, for `errors`; 0: blocks were kept out.
    """

    robot: str
    axes: tuple[str, ...]
    arm: ChamberArm
    rest_pa: float
    span_pa: float
    times_s: Array
    numbers: Array
    begins: Beginning
    high: Array
    memory: Array
    errors: tuple[AheadError, ...]
    source: str
    remembered: RememberedMotion | None = None
    memory_step_s: float = OLD_STEP_S
    apart: int = 0

    def predict(self, sent: Array, period_s: float, at_s: Array | None = None, load_kg: float = 0.0) -> Array:
        """Tips ``(samples, 3)`` [m] in the base frame, from set-points alone; the arm rests before.

        Args:
            sent: set-points, held from tick to tick, ``(ticks, axes)`` [Pa].
            period_s: between two of them; the first is at time 0.
            at_s: times of the tips; None for those of the set-points.
            load_kg: mass of a payload, which this model does not have: 0.

        Raises:
            ContidError: set-points of another number of axes or not finite, or a payload.
        """
        sent = checked_commands(sent, period_s, self.robot, len(self.axes))
        if load_kg != 0.0:
            raise ContidError(
                f"{self.robot}: payloads are not part of the motion of pneumatic arms; leave them out"
            )
        at_s = np.arange(float(len(sent))) * period_s if at_s is None else at_s
        x = self.inflated(sent, period_s, float(at_s[-1]))
        tips = self.tips(x, self.begins)
        if self.remembered is not None:
            tips += self.remembered.added(self.states(x, period_s), 0.0)
        return between(tips, at_s / self.step_of(period_s))

    def zeroed(self, sent: Array, period_s: float, at_s: Array, tip_m: Array) -> Self:
        """The same arm with its beginning by the first tips of a recording."""
        first = tip_m[at_s <= at_s[0] + ZERO_S].mean(axis=0)
        x = self.inflated(sent, period_s, period_s)
        return replace(self, begins=self.beginning(x[:1], first))

    def outside(self, sent: Array, period_s: float, at_s: Array, load_kg: float = 0.0) -> float:
        """Share of the time in which a chamber has more pressure than in the recordings of the fit."""
        x = self.inflated(sent, period_s, float(at_s[-1]))
        return float((x > 1.05 * self.high + 0.01).any(axis=1).mean())

    @staticmethod
    def step_of(period_s: float) -> float:
        """Step of the simulation [s]: whole periods, `STEP_S` at most where they are shorter."""
        return period_s * max(int(STEP_S / period_s), 1)

    def inflated(self, sent: Array, period_s: float, until_s: float) -> Array:
        """Inflation of the chambers, about 0 to 1, on steps of `step_of`; ``(steps, axes)``."""
        step_s = self.step_of(period_s)
        at_s = np.arange(np.ceil(until_s / step_s) + 1.0) * step_s
        late = between((sent - self.rest_pa) / self.span_pa, (at_s - self.times_s[0]) / period_s)
        return filled(filled(late, step_s, *self.times_s[1:3].tolist()), step_s, *self.times_s[3:5].tolist())

    def states(self, x: Array, period_s: float) -> Array:
        """Inflations ``(steps, axes)`` now and before, by which recordings are remembered."""
        steps = np.arange(len(x))
        ago = (round(ago_s / self.step_of(period_s)) for ago_s in _AGO_S)
        return np.hstack([x[np.maximum(steps - each, 0)] for each in ago])

    def tips(self, x: Array, begins: Beginning) -> Array:
        """Tips ``(steps, 3)`` [m] of inflations ``(steps, axes)`` from a beginning on."""
        bends, lengths = self.arcs(x, begins)
        return chained(bends, lengths, self.arm.link_m) + begins.offset_m

    def arcs(self, x: Array, begins: Beginning) -> tuple[Array, Array]:
        """Bends ``(steps, sections, 2)`` [rad] and lengths ``(steps, sections)`` [m]."""
        bends = np.empty((len(x), self.arm.sections, 2))
        lengths = np.empty((len(x), self.arm.sections))
        above = np.zeros((len(x), 2))
        for k, numbers in enumerate(self.numbers.tolist()):
            straight, grows, _, others, elastic, play, _, bend, coupled = numbers
            own = self.arm.section == k
            directions = self.arm.directions[own]
            bent = np.linalg.norm(directions, axis=1) > 0.0
            force = grows * (x[:, own] @ np.where(bent, 1.0, others))
            sides = x[:, own] @ directions
            slid = played(force, play, force[0] + begins.share * play)
            free = straight + elastic * force + (1.0 - elastic) * slid
            wished = bend * sides + coupled * above
            lengths[:, k], bends[:, k] = self._arc(k, free, wished + begins.bends[k] - wished[0])
            above += sides
        return bends, lengths

    def _arc(self, section: int, free: Array, bends: Array) -> _Arcs:
        """A section as long ``(n,)`` and as bent ``(n, 2)`` as its longest length lets it."""
        longest, side = self.numbers[section, [_LONGEST, _SIDE]].tolist()
        lengths = bounded(np.maximum(free, 1e-3), longest, _LENGTH_MEETS)
        size = np.maximum(np.linalg.norm(bends, axis=1), 1e-9)
        most = np.maximum(((1.0 + _FREE) * longest - lengths) / side, 0.02)
        return _Arcs(lengths, bends * (bounded(size, most, _BEND_MEETS) / size)[:, None])

    def beginning(self, x: Array, tip_m: Array) -> Beginning:
        """Bends and play with which the arm of ``x`` ``(1, axes)`` begins at a tip, as small as fits it.

        What they do not reach is left to the offset.
        """
        count = 2 * self.arm.sections
        spread = np.append(np.full(count, _BENDS_RAD), _SHARE)
        values = np.zeros(count + 1)
        for _ in range(3):
            tips = self._first_tips(x[0], np.vstack([values, values + 1e-4 * np.eye(count + 1)]))
            scaled = (tips[1:] - tips[0]).T / 1e-4 * spread
            left = tip_m - tips[0] + scaled @ (values / spread)
            values = spread * (scaled.T @ np.linalg.solve(scaled @ scaled.T + _TIP_M**2 * np.eye(3), left))
            values[-1] = np.clip(values[-1], -0.999, 0.999)
        offset = tip_m - self._first_tips(x[0], values[None, :])[0]
        return Beginning(values[:-1].reshape(-1, 2), float(values[-1]), offset)

    def _first_tips(self, x: Array, values: Array) -> Array:
        """First tips ``(n, 3)`` of inflations ``(axes,)``; rows of bends and the share of the play."""
        bends, lengths = (
            values[:, :-1].reshape(len(values), -1, 2).copy(),
            np.empty((len(values), self.arm.sections)),
        )
        for k, numbers in enumerate(self.numbers.tolist()):
            straight, grows, _, others, elastic, play = numbers[:6]
            own = self.arm.section == k
            bent = np.linalg.norm(self.arm.directions[own], axis=1) > 0.0
            force = grows * float(x[own] @ np.where(bent, 1.0, others))
            free = straight + force + (1.0 - elastic) * values[:, -1] * play
            lengths[:, k], bends[:, k] = self._arc(k, free, bends[:, k])
        return chained(bends, lengths, self.arm.link_m)

    @property
    def open_loop(self) -> AheadError:
        """Errors of predictions from set-points alone."""
        return self.errors[-1]


def filled(values: Array, step_s: float, up_s: float, down_s: float) -> Array:
    """Values ``(steps, n)`` behind a lag with a time constant for rising and one for falling."""
    up, down = 1.0 - np.exp(-step_s / np.array([up_s, down_s]))
    out = np.empty_like(values)
    for k, column in enumerate(values.T.tolist()):
        x, found = column[0], []
        for value in column:
            x += (up if value > x else down) * (value - x)
            found.append(x)
        out[:, k] = found
    return out


def bounded(values: Array, most: Array | float, sharpness: float) -> Array:
    """Positive values that approach ``most`` smoothly."""
    return np.asarray(values / (1.0 + (values / most) ** sharpness) ** (1.0 / sharpness))
