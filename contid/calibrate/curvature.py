"""Curvature correction of a rack finger from marker positions (Morita et al., section IV-C).

Markers along the finger are photographed in several postures. A circle fitted to the markers of a posture has
the actual curvature k; the racks say the commanded curvature k_d and the arc length S. Then (Eq. 11)

    k / k_d - 1 = epsilon = a S + b

is fitted by least squares over the postures. A short or nearly straight posture says little about epsilon:
noise on its markers counts with ``1 / (k_d S^2)``. The weight of a posture is therefore

    w = 1 / (tau^2 + s^2),    s: from the residuals of all circles,   tau: scatter from posture to posture,

tau being what the residuals of the line have beyond s (`contid.calibrate.line`). Intervals of equal weights
hold in 70 to 80 % of such cases instead of 95.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.calibrate.circle import CircleFit, Floats, fit_circle
from contid.calibrate.line import fit_line
from contid.calibrate.measured_table import Columns, MeasuredRow, read_measured
from contid.errors import BadInputError, ContidError, Located

#: Below this commanded curvature [1/mm] the quotient k/k_d is mostly noise.
LEAST_CURVATURE_PER_MM: Final = 1e-3
#: A finger that bends by less than this share of what it is told does not bend.
LEAST_SHARE: Final = 1e-3
CONFIDENCE: Final = 0.95
COLUMNS: Final = Columns(
    [("left_mm,right_mm", "arc_length_mm,curvature_per_mm"), ("x_mm,y_mm", "x_px,y_px")], message=("posture",)
)


@dataclass(frozen=True, slots=True)
class Posture:
    """One photographed posture.

    Attributes:
        name: as written in the data.
        arc_length_mm: commanded S.
        commanded_per_mm: commanded curvature k_d, not negative.
        circle: fitted to its markers [mm].
        markers: how many.
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
    """The line ``epsilon = a S + b`` with what is known about its quality.

    Attributes:
        a_per_mm, b: the coefficients.
        a_half_width_per_mm, b_half_width: half widths of their 95 % confidence intervals.
        rms_epsilon: of the residuals.
        arc_length_mm: range of S in the data, where the line may be used.
        postures: what was fitted.
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
    """Read markers, one row each: ``posture``, its command, and the marker's place.

    The command is ``left_mm,right_mm`` (racks) or ``arc_length_mm,curvature_per_mm``; the place is
    ``x_mm,y_mm`` or ``x_px,y_px``, for which ``mm_per_px`` is needed.

    Raises:
        BadInputError: every wrong row; postures with fewer than three markers or two commands.
    """
    rows = read_measured(lines, name, COLUMNS)
    if "x_px" in rows[0].numbers and mm_per_px is None:
        raise BadInputError([Located(name, 1, 1, "markers in pixels: say how large one is with --mm-per-px")])
    groups: dict[str, list[MeasuredRow]] = {}
    for row in rows:
        groups.setdefault(row.message["posture"], []).append(row)
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
    if commanded_per_mm < LEAST_CURVATURE_PER_MM:
        raise ValueError(
            f"commanded curvature {commanded_per_mm:g} /mm is below {LEAST_CURVATURE_PER_MM:g} /mm; "
            "a straight posture says nothing about the quotient"
        )
    unit = "px" if "x_px" in markers[0].numbers else "mm"
    scale = mm_per_px if unit == "px" else 1.0
    points = np.array([[row.numbers[f"x_{unit}"], row.numbers[f"y_{unit}"]] for row in markers]) * scale
    circle = fit_circle(points)
    if circle.curvature < LEAST_SHARE * commanded_per_mm:
        raise ValueError(
            f"its markers lie on a line, but its commanded curvature is {commanded_per_mm:g} /mm"
        )
    return Posture(name, arc_length_mm, commanded_per_mm, circle, len(markers))


def _command(row: MeasuredRow, rack_spacing_mm: float) -> tuple[float, float]:
    numbers = row.numbers
    if "arc_length_mm" in numbers:
        return numbers["arc_length_mm"], abs(numbers["curvature_per_mm"])
    arc_length_mm = 0.5 * (numbers["left_mm"] + numbers["right_mm"])
    turned = abs(numbers["right_mm"] - numbers["left_mm"]) / rack_spacing_mm
    return arc_length_mm, turned / arc_length_mm if arc_length_mm > 0.0 else 0.0


def fit_curvature(postures: list[Posture]) -> CurvatureFit:
    """Fit Eq. 11.

    Raises:
        ContidError: fewer than three postures, or all at one arc length.
    """
    from scipy.stats import t

    lengths = np.array([posture.arc_length_mm for posture in postures])
    if len(postures) < 3 or float(np.ptp(lengths)) == 0.0:
        raise ContidError(
            f"{len(postures)} postures at {len(set(lengths.tolist()))} arc lengths do not determine a line; "
            "give at least three postures at two arc lengths"
        )
    epsilon = np.array([posture.epsilon for posture in postures])
    (slope, intercept), errors = fit_line(lengths, epsilon, _marker_variances(postures))
    quantile = float(t.ppf(0.5 + 0.5 * CONFIDENCE, len(postures) - 2))
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


def _marker_variances(postures: list[Posture]) -> Floats:
    """What noise on the markers, the same in all photographs, makes of every epsilon."""
    freedom = sum(max(posture.markers - 3, 0) for posture in postures)
    squares = sum(posture.markers * posture.circle.rms**2 for posture in postures if posture.markers > 3)
    noise = math.sqrt(squares / freedom) if freedom else 0.0
    errors = [posture.circle.error_per_noise / posture.commanded_per_mm for posture in postures]
    return (noise * np.array(errors)) ** 2
