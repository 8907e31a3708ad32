"""A calibrated tendon robot in the units of robot files, for reports and for the robot file."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid.robot_file.edit import Change
from contid.robot_file.tendon.robot import TendonRobot
from contid.units import MM_PER_M
from contid_fit.calibrate.tendon.accuracy import Accuracy
from contid_fit.calibrate.tendon.capstan import capstan_coefficient, measured_capstan
from contid_fit.calibrate.tendon.geometry import FoundGeometry
from contid_fit.calibrate.tendon.recording import TendonRecording
from contid_fit.calibrate.tendon.stages import FRICTION_STAGE, Stage

#: Group of the fit -> name in reports, factor, and whether the logarithm was fitted.
_REPORTED: Final = {
    "radius_m": ("radius_mm", 1e3, False),
    "angle_rad": ("angle_deg", math.degrees(1.0), False),
    "twist_rad": ("twist_deg", math.degrees(1.0), False),
    "offset_m": ("offset_mm", 1e3, False),
    "length_m": ("length_mm", 1e3, False),
    "log_stiffness": ("stiffness_mm2", 1e6, True),
    "log_hardening": ("hardening_per_mm", 1e-3, True),
    "rest_rad": ("rest_deg", math.degrees(1.0), False),
    "log_friction": ("friction_mm2", 1e6, True),
    "log_play": ("play_mm", 1e3, True),
    "base_m": ("base_mm", 1e3, False),
    "tilt_rad": ("tilt_deg", math.degrees(1.0), False),
    "marker_m": ("marker_mm", 1e3, False),
}
_SERVO_ID = re.compile(r"servo_(\d+)_mm")


@dataclass(frozen=True, slots=True)
class FittedNumber:
    """A fitted parameter in the unit of its name, with its 95 % interval.

    Attributes:
        name: name of the quantity, with its unit: ``radius_mm``.
        label: tendon, section or axis that it belongs to: ``s1.t2``.
        value: the estimate.
        low, high: ends of the interval.
    """

    name: str
    label: str
    value: float
    low: float
    high: float

    @property
    def half_width(self) -> float:
        """Half of the interval."""
        return 0.5 * (self.high - self.low)


def numbers(stage: Stage) -> Iterator[FittedNumber]:
    """All parameters of a stage of statics."""
    parameters = stage.fit.model.parameters
    values, widths = parameters.split(stage.fit.vector), parameters.split(stage.fit.half_width)
    for group in parameters.groups:
        name, factor, logarithm = _REPORTED[group.name]
        rows = zip(group.labels, values[group.name], widths[group.name], strict=True)
        for label, value, width in rows:
            ends = np.array([value, value - width, value + width])
            here, low, high = factor * (np.exp(np.minimum(ends, 50.0)) if logarithm else ends)
            yield FittedNumber(name, label, float(here), float(low), float(high))


def millimetres(found: Accuracy | None) -> dict[str, object] | None:
    """Errors of a stage in mm, each with its 95 % interval; None for none."""
    if found is None:
        return None
    return {
        "rmse_mm": found.rmse_m * MM_PER_M,
        "rmse_95_mm": [each * MM_PER_M for each in found.rmse_95_m],
        "mean_mm": found.mean_m * MM_PER_M,
        "mean_95_mm": [each * MM_PER_M for each in found.mean_95_m],
        "rows": found.rows,
    }


def residual_of(stage: Stage) -> dict[str, float | list[float]] | None:
    """The correction of a stage as the robot file has it; None where none was accepted.

    The fit counts the stretch of a tendon from the state in which it is slack, the file from its pretension.
    """
    residual = stage.residual
    if residual is None or not math.isfinite(residual.penalty):
        return None
    bends, count = residual.bends, len(residual.low)
    slack_mm = MM_PER_M * stage.fit.model.parameters.split(stage.fit.vector)["offset_m"]
    unit = np.ones(len(residual.scale))
    unit[bends:count] = 1.0 / MM_PER_M  # stretches in mm
    per_term = residual.gain[:-1] * (unit / residual.scale)[:, None]
    constant = residual.gain[-1] - (residual.centre / residual.scale) @ residual.gain[:-1]
    constant = constant + slack_mm @ per_term[bends:count]
    gain = MM_PER_M * np.vstack((per_term, constant))
    ends = []
    for each in (residual.low, residual.high):
        ends.append(np.concatenate((each[:bends], MM_PER_M * each[bends:] - slack_mm)))
    return {
        "low_rad_mm": _rounded(ends[0]),
        "high_rad_mm": _rounded(ends[1]),
        "gain_x_mm": _rounded(gain[:, 0]),
        "gain_y_mm": _rounded(gain[:, 1]),
        "gain_z_mm": _rounded(gain[:, 2]),
        "bound_mm": float(f"{MM_PER_M * residual.bound_m:.6g}"),
    }


def _rounded(values: Array) -> list[float]:
    return [float(f"{value:.9g}") for value in values.tolist()]


def friction_predicts(stages: Sequence[Stage]) -> bool:
    """True where the stage with friction predicts the rows kept out better than the one without.

    Without such rows the rows of the fit decide.
    """
    with_it = next(k for k, stage in enumerate(stages) if stage.name == FRICTION_STAGE)
    after, before = stages[with_it], stages[with_it - 1]
    if after.held_out is None or before.held_out is None:
        return after.train.rmse_m < before.train.rmse_m
    return after.held_out.rmse_m < before.held_out.rmse_m


def friction_changes(
    stage: Stage, robot: TendonRobot, data: TendonRecording, note: str, add: bool
) -> list[Change]:
    """Play and capstan coefficient, where ``add`` or where the file has ``friction``.

    Args:
        stage: one whose model has friction, `FRICTION_STAGE` or later.
        robot: robot of the file; the coefficient goes with arcs and ``tension`` only.
        data: rows of the fit; load cells at both ends of its tendons go before the work of the friction.
        note: origin.
        add: also into a file that has none.
    """
    if robot.friction is None and not add:
        return []
    plays = [round(each.value, 4) for each in numbers(stage) if each.name == "play_mm"]
    found: dict[str, list[float]] = {"play_mm": plays}
    coefficient = measured_capstan(stage.fit, data) or capstan_coefficient(stage.fit, data.pull_m)
    if coefficient is not None and robot.tension is not None and robot.rod is None:
        found["capstan"] = [min(1.0, round(coefficient.value, 4))]
        note = f"{note}, capstan {coefficient.low:.2g} to {coefficient.high:.2g} (95 %)"
    if robot.friction is None:
        return [Change("friction", dict(found), note)]
    return [Change(f"friction.{key}", value, note) for key, value in found.items()]


def changes(
    stage: Stage, robot: TendonRobot, servos: Sequence[str], geometry: FoundGeometry | None, note: str
) -> list[Change]:
    """Changes of the robot file that a fit gives.

    Lengths, radii and azimuths of the sections; the bending stiffness, from the stiffness of the tendons
    that the file states, because a recording without forces gives only their quotient; the residual where
    one was accepted; and the servo of each tendon where geometry was found and both have numbers.
    """
    of: dict[str, list[FittedNumber]] = {}
    for number in numbers(stage):
        of.setdefault(number.name, []).append(number)
    out = []
    place = 0
    for s, section in enumerate(robot.geometry.sections):
        own = slice(place, place + len(section.angles_deg))
        place = own.stop
        key = f"geometry.sections.{s}."
        radii, angles, length = of["radius_mm"][own], of["angle_deg"][own], of["length_mm"][s]
        widest = ", ".join(
            (
                f"+- {length.half_width:.2g} mm",
                f"{max(each.half_width for each in radii):.2g} mm",
                f"{max(each.half_width for each in angles):.2g} deg (95 %)",
            )
        )
        out += [
            Change(key + "length_mm", round(length.value, 3)),
            Change(key + "radius_mm", [round(each.value, 4) for each in radii]),
            Change(key + "angles_deg", [round(each.value, 3) for each in angles], f"{note}, {widest}"),
        ]
    if robot.tension is not None:
        stretch = robot.per_section(robot.tension.tendon_n_per_mm)
        bending = [
            float(f"{ratio.value * each * length.value:.4g}")
            for ratio, each, length in zip(of["stiffness_mm2"], stretch, of["length_mm"], strict=True)
        ]
        out.append(Change("tension.bending_n_mm2", bending, f"{note}, by tendon_n_per_mm"))
    if robot.tension is not None and robot.rod is None and (found := residual_of(stage)) is not None:
        out.append(Change("residual", found, note))
    if geometry is not None:
        ids = [_SERVO_ID.fullmatch(servo) for servo in servos]
        extra = [robot.axes[name].model_extra or {} for name in robot.axis_names]
        if all(ids) and all(isinstance(each.get("id"), int) for each in extra):
            out += [
                Change(f"axes.{name}.id", int(match[1]))
                for name, match in zip(robot.axis_names, ids, strict=True)
                if match
            ]
    return out
