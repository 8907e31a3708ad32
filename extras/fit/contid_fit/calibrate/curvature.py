"""Curvature correction of a rack finger from marker positions (Morita et al., section IV-C).

Markers along the finger are photographed in several postures. A circle fitted to the markers of a posture has
the actual curvature k; the racks give the commanded curvature k_d and the arc length S. Then (Eq. 11)

    k / k_d - 1 = epsilon = a S + b

is fitted by least squares over the postures. In a short or nearly straight posture the marker noise enters
epsilon with the factor ``1 / (k_d S^2)``. The weight of a posture is therefore

    w = 1 / (tau^2 + s^2),    s: marker noise (residuals of all circles),   tau: scatter between postures,

with tau from the residuals of the line (`contid_fit.calibrate.line`). With equal weights the 95 % intervals
cover only 70 to 80 % of such cases.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.errors import BadInputError, ContidError, Located
from contid.kinematics.array import Array
from contid_fit.calibrate.circle import CircleFit, fit_circle
from contid_fit.calibrate.line import fit_line
from contid_fit.calibrate.measured_table import Columns, MeasuredRow, read_measured

#: Below this commanded curvature [1/mm] the quotient k/k_d is mostly noise.
MIN_CURVATURE_PER_MM: Final = 1e-3
#: A finger that bends by less than this share of its command counts as straight.
MIN_SHARE: Final = 1e-3
CONFIDENCE: Final = 0.95
COLUMNS: Final = Columns(
    [("left_mm,right_mm", "arc_length_mm,curvature_per_mm"), ("x_mm,y_mm", "x_px,y_px")], text=("posture",)
)


@dataclass(frozen=True, slots=True)
class Posture:
    """One photographed posture.

    Attributes:
        name: as written in the data.
        arc_length_mm: commanded S.
        commanded_per_mm: commanded curvature k_d, not negative.
        circle: fitted to the markers [mm].
        markers: number of markers.
    """

    name: str
    arc_length_mm: float
    commanded_per_mm: float
    circle: CircleFit
    markers: int

    @property
    def epsilon(self) -> float:
        """``k / k_d - 1``."""
        return self.circle.curvature / self.commanded_per_mm - 1.0


@dataclass(frozen=True, slots=True)
class CurvatureFit:
    """The line ``epsilon = a S + b`` and its quality.

    Attributes:
        a_per_mm, b: the coefficients.
        a_half_width_per_mm, b_half_width: half widths of their 95 % confidence intervals.
        rms_epsilon: root mean square of the residuals.
        arc_length_mm: range of S in the data, in which the line is valid.
        postures: the fitted data.
    """

    a_per_mm: float
    b: float
    a_half_width_per_mm: float
    b_half_width: float
    rms_epsilon: float
    arc_length_mm: tuple[float, float]
    postures: tuple[Posture, ...]


def read_postures(
    lines: Iterable[str], name: str, *, rack_spacing_mm: float, mm_per_px: float | None
) -> list[Posture]:
    """Read markers, one row each: ``posture``, its command, and the marker's position.

    The command is ``left_mm,right_mm`` (racks) or ``arc_length_mm,curvature_per_mm``; the position is
    ``x_mm,y_mm`` or ``x_px,y_px`` (requires ``mm_per_px``).

    Raises:
        BadInputError: every invalid row; postures with fewer than three markers or with several commands.
    """
    rows = read_measured(lines, name, COLUMNS)
    if "x_px" in rows[0].numbers and mm_per_px is None:
        raise BadInputError([Located(name, 1, 1, "markers in pixels: give the pixel size with --mm-per-px")])
    groups: dict[str, list[MeasuredRow]] = {}
    for row in rows:
        groups.setdefault(row.text["posture"], []).append(row)
    findings: list[Located] = []
    postures = []
    for posture, markers in groups.items():
        try:
            postures.append(_posture(posture, markers, rack_spacing_mm, mm_per_px or 1.0))
        except ValueError as error:
            findings.append(Located(name, markers[0].line, 1, f"posture {posture!r}: {error}"))
    if findings:
        raise BadInputError(findings)
    return postures


def _posture(name: str, markers: list[MeasuredRow], rack_spacing_mm: float, mm_per_px: float) -> Posture:
    commands = {_command(row, rack_spacing_mm) for row in markers}
    if len(commands) > 1:
        raise ValueError(f"its rows have {len(commands)} different commands")
    arc_length_mm, commanded_per_mm = commands.pop()
    if arc_length_mm <= 0.0:
        raise ValueError(f"arc length {arc_length_mm:g} mm is not positive")
    if commanded_per_mm < MIN_CURVATURE_PER_MM:
        raise ValueError(
            f"commanded curvature {commanded_per_mm:g} /mm is below {MIN_CURVATURE_PER_MM:g} /mm; "
            "k / k_d of a straight posture is undefined"
        )
    unit = "px" if "x_px" in markers[0].numbers else "mm"
    scale = mm_per_px if unit == "px" else 1.0
    points = np.array([[row.numbers[f"x_{unit}"], row.numbers[f"y_{unit}"]] for row in markers]) * scale
    circle = fit_circle(points)
    if circle.curvature < MIN_SHARE * commanded_per_mm:
        raise ValueError(
            f"its markers lie on a line, but its commanded curvature is {commanded_per_mm:g} /mm"
        )
    return Posture(name, arc_length_mm, commanded_per_mm, circle, len(markers))


def _command(row: MeasuredRow, rack_spacing_mm: float) -> tuple[float, float]:
    numbers = row.numbers
    if "arc_length_mm" in numbers:
        return numbers["arc_length_mm"], abs(numbers["curvature_per_mm"])
    arc_length_mm = 0.5 * (numbers["left_mm"] + numbers["right_mm"])
    bend_rad = abs(numbers["right_mm"] - numbers["left_mm"]) / rack_spacing_mm
    return arc_length_mm, bend_rad / arc_length_mm if arc_length_mm > 0.0 else 0.0


def fit_curvature(postures: list[Posture]) -> CurvatureFit:
    """Fit Eq. 11.

    Raises:
        ContidError: fewer than three postures, or all at one arc length.
    """
    from scipy.special import stdtrit

    lengths = np.array([posture.arc_length_mm for posture in postures])
    if len(postures) < 3 or float(np.ptp(lengths)) == 0.0:
        raise ContidError(
            f"{len(postures)} postures at {len(set(lengths.tolist()))} arc lengths do not determine a line; "
            "give at least three postures at two arc lengths"
        )
    epsilon = np.array([posture.epsilon for posture in postures])
    (slope, intercept), errors = fit_line(lengths, epsilon, _marker_variances(postures))
    quantile = float(stdtrit(len(postures) - 2, 0.5 + 0.5 * CONFIDENCE))
    residuals = epsilon - (slope * lengths + intercept)
    return CurvatureFit(
        a_per_mm=slope,
        b=intercept,
        a_half_width_per_mm=quantile * errors[0],
        b_half_width=quantile * errors[1],
        rms_epsilon=float(np.sqrt(np.mean(residuals**2))),
        arc_length_mm=(float(lengths.min()), float(lengths.max())),
        postures=tuple(postures),
    )


def _marker_variances(postures: list[Posture]) -> Array:
    """Variance of every epsilon due to marker noise, which is the same in all photographs."""
    degrees_of_freedom = sum(max(posture.markers - 3, 0) for posture in postures)  # a circle has 3 parameters
    squares_mm2 = sum(posture.markers * posture.circle.rms**2 for posture in postures if posture.markers > 3)
    noise_mm = math.sqrt(squares_mm2 / degrees_of_freedom) if degrees_of_freedom else 0.0
    epsilon_per_mm = [posture.circle.error_per_noise / posture.commanded_per_mm for posture in postures]
    return (noise_mm * np.array(epsilon_per_mm)) ** 2
