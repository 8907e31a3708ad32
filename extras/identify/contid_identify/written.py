"""Changes of the robot file that an identification gives.

``follow_delay_ms`` and ``follow_lag_ms`` of every axis, the longest that still count as healthy, are the
upper ends of its intervals and a quarter; ``follow_least_delay_ms`` and ``follow_least_lag_ms``, the
shortest, are the lower ends less a fifth, where both are known apart. ``dynamics.delay_ms`` and ``lag_ms``
reach from the command to the body: those of the tip where it was measured, else of every axis. Masses and
damping are those of the stage *body*, ``rates.shape`` has the strongest mode about the pose with the most
ring-downs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from contid.errors import ContidError
from contid.robot_file.dynamics import Dynamics
from contid.robot_file.edit import Change
from contid.robot_file.rates import HIGHEST_HZ, LOWEST_HZ
from contid.robot_file.robot import RobotDescription
from contid_identify.body_fit import scaled
from contid_identify.estimate import Interval
from contid_identify.ring_down import RingDown
from contid_identify.stages import IdentifiedMotion

#: What the watch of the axes allows above the upper end of an interval, and below the lower one.
_MARGIN = 1.25
#: An interval of a delay or lag wider than this is not written [s].
_WIDEST_S = 0.05


@dataclass(frozen=True, slots=True)
class FileChanges:
    """What is written into the robot file, and what is not.

    Attributes:
        changes: keys relative to the robot.
        unknown: keys of delays and lags that the recordings do not fix, with the reason.
        left_out: the same of what was asked for in particular: ring-downs and the body.
    """

    changes: list[Change] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)


def changes(found: IdentifiedMotion, robot: RobotDescription, note: str) -> FileChanges:
    """What an identification gives for a robot file.

    Args:
        found: what was identified.
        robot: description in the file.
        note: origin of the numbers: date, recordings, split.

    Raises:
        ContidError: nothing is known well enough to be written.
    """
    of_file = FileChanges()
    out, unknown, left_out = of_file.changes, of_file.unknown, of_file.left_out
    for axis in found.axes:
        if (answer := axis.answer) is None:
            unknown.append(f"axes.{axis.name}: {axis.refused}")
            continue
        if not _is_known(answer.sum_s):
            unknown.append(f"axes.{axis.name}: delay and lag together are {_uncertain(answer.sum_s)}")
            continue
        delay_s, lag_s = (_highest(each, answer.sum_s) for each in (answer.delay_s, answer.lag_s))
        own, healthy = f"axes.{axis.name}", f"{note}: longest when healthy"
        out += [
            Change(f"{own}.follow_delay_ms", _ms(_MARGIN * delay_s), healthy),
            Change(f"{own}.follow_lag_ms", max(_ms(_MARGIN * lag_s), 1.0), healthy),
        ]
        if _is_known(answer.delay_s) and _is_known(answer.lag_s):
            shortest = f"{note}: shortest when healthy"
            out += [
                Change(f"{own}.follow_least_{key}_ms", _ms(max(of.low, 0.0) / _MARGIN), shortest)
                for key, of in (("delay", answer.delay_s), ("lag", answer.lag_s))
            ]
        else:
            unknown.append(f"{own}.follow_least_delay_ms, follow_least_lag_ms: only the sum of both is known")
    if getattr(robot, "dynamics", None) is not None:
        if not (delays := _dynamics(found, len(robot.axis_names), note)):
            unknown.append("dynamics.delay_ms, lag_ms: known neither to the tip nor of every axis")
        out += delays
        out += _body(found, robot, note, left_out)
    if found.ring_downs:
        try:
            out.append(shape_of(found.ring_downs[0], robot, note))
        except ContidError as error:
            if not out:
                raise
            left_out.append(str(error))
    if not out:
        raise ContidError(f"nothing is known well enough to be written: {'; '.join(unknown + left_out)}")
    return of_file


def _dynamics(found: IdentifiedMotion, count: int, note: str) -> list[Change]:
    tip = found.tip
    if tip is not None and _is_known(tip.delay_s) and _is_known(tip.lag_s):
        error = tip.stages[-1 if tip.frequency_hz is not None else -2].kept_out.rmse
        about = f"{note}: to the tip, +- {_ms(tip.delay_s.half)} ms, kept out {1e3 * error:.2g} mm"
        return [
            Change("dynamics.delay_ms", [_ms(tip.delay_s.value)], about),
            Change("dynamics.lag_ms", [_ms(tip.lag_s.value)], f"{note}: +- {_ms(tip.lag_s.half)} ms"),
        ]
    own = [axis.answer for axis in found.axes[:count]]
    answers = [each for each in own if each is not None and _is_known(each.delay_s) and _is_known(each.lag_s)]
    if len(answers) < count:
        return []
    return [
        Change("dynamics.delay_ms", [_ms(each.delay_s.value) for each in answers], f"{note}: of the axes"),
        Change("dynamics.lag_ms", [_ms(each.lag_s.value) for each in answers], f"{note}: of the axes"),
    ]


def _body(found: IdentifiedMotion, robot: RobotDescription, note: str, left_out: list[str]) -> list[Change]:
    if found.body is None:
        return []
    body = found.body
    if not math.isfinite(body.mass.half) or body.mass.half > 0.5 * body.mass.value:
        left_out.append("dynamics: the mass of the body is not written: allowed is what is known to a half")
        return []
    old: Dynamics = getattr(robot, "dynamics")  # noqa: B009
    new = scaled(old, body.mass.value, body.damping_s.value)
    assert new.mass_g_per_m is not None
    error = 1e3 * body.stages[-1].kept_out.rmse
    share = 100.0 * body.mass.half / body.mass.value
    out = [
        Change(
            "dynamics.mass_g_per_m",
            [float(f"{each:.4g}") for each in new.mass_g_per_m],
            f"{note}: +- {share:.2g} %, kept out {error:.2g} mm",
        ),
    ]
    if math.isfinite(body.damping_s.half):
        about = f"{note}: +- {_ms(body.damping_s.half)} ms"
        out.append(Change("dynamics.damping_ms", float(f"{new.damping_ms:.3g}"), about))
    else:
        left_out.append("dynamics.damping_ms is not written: the recordings do not show it")
    if old.tip_mass_g:
        out.append(Change("dynamics.tip_mass_g", float(f"{new.tip_mass_g:.4g}"), note))
    return out


def shape_of(ring: RingDown, robot: RobotDescription, note: str) -> Change:
    """Input shaping for a mode; a schedule over poses is kept, and scaled to it at its pose."""
    mode = ring.modes[0]
    hz, ratio = mode.frequency_hz, mode.ratio
    low, high = LOWEST_HZ, HIGHEST_HZ
    if not low <= hz.value <= high or not math.isfinite(hz.half) or hz.half > 0.2 * hz.value:
        raise ContidError(
            f"rates.shape: {hz.value:.3g} +- {hz.half:.2g} Hz is not written; allowed: {low:g} to {high:g} "
            "Hz, known to a fifth: record more ring-downs"
        )
    old = robot.rates.shape
    value: dict[str, Any] = {
        "kind": "zvd" if old is None else old.kind.value,
        "frequency_hz": float(f"{hz.value:.4g}"),
        "damping_ratio": float(f"{min(ratio.value, 0.9):.3g}"),
    }
    if old is not None and old.schedule is not None:
        own = robot.quantity.from_si(ring.command[: len(robot.axis_names)])
        share = hz.value / old.schedule.frequencies(own.tolist())[0]
        value |= {
            "frequency_hz": min(max(old.frequency_hz * share, low), high),
            "damping_ratio": old.damping_ratio,
            "schedule": old.schedule.scaled(share).model_dump(mode="json", exclude_defaults=True),
        }
        about = f"{note}: scaled to {hz.value:.4g} +- {hz.half:.2g} Hz at its pose, ratio as before"
    else:
        known = f"ratio +- {ratio.half:.1g}" if math.isfinite(ratio.half) else "its ratio is uncertain"
        about = f"{note}: +- {hz.half:.2g} Hz, {known}"
    return Change("rates.shape", value, about)


def _uncertain(of: Interval) -> str:
    finite = math.isfinite(of.half)
    known = f"{1e3 * of.value:.0f} +- {1e3 * of.half:.0f} ms" if finite else "not fixed by these data"
    return f"{known}; allowed: +- {1e3 * _WIDEST_S:g} ms"


def _is_known(of: Interval) -> bool:
    return math.isfinite(of.half) and of.half <= _WIDEST_S


def _highest(of: Interval, sum_s: Interval) -> float:
    """The upper end; where delay and lag are known as a sum only, the sum bounds both."""
    return max(0.0, (of if _is_known(of) else sum_s).high)


def _ms(seconds: float) -> float:
    return float(f"{1e3 * seconds:.3g}")
