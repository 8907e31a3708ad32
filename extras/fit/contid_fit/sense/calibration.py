"""The error of a model without load: offset, gain and hysteresis of every axis, and the errors of a rod.

A model with wrong regulators misses the measured tip as if it had other pressures, one with wrong moduli,
moments or masses as another rod::

    y = h(q + D a + e, F = 0; s) + n      D = [I, diag(q - middle), diag(side)]

theta = (a, s), a an offset, a gain and half a hysteresis loop per axis (`contid_fit.sense.play`), s the
parameters of a `Family` of models, is found by generalised least squares with priors, linearised again in
every round. What remains is explained by e, an error of every axis of standard deviation sigma that stays as
long as the actuation, and n (tracker and everything else). sigma is the one under which the remaining errors
are most likely. A side that is not known (NaN) is evenly likely to be anywhere from -1 to 1. So a wrong model
is not reported as a load, and its remaining error is in the uncertainty of the load.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Protocol

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.kinematics.cosserat.identified import SectionErrors, scaled_arm
from contid.kinematics.cosserat.model import CosseratModel
from contid.kinematics.model import Compliant, Model
from contid.robot_file.cosserat import Cosserat
from contid.targets import ZERO3, Actuation, Vec3
from contid_fit.sense.creep import Creep, Drifts, creep_of

#: Poses per axis that a calibration needs: 3 measured values per pose against 2 unknowns per axis.
MIN_POSES_PER_AXIS: Final = 3
_ROUNDS: Final = 6
#: Standard deviations before a calibration: offsets and half loops as parts of the range, gains of axes.
_OFFSET: Final = 0.05
_LOOP: Final = 0.02
_GAIN: Final = 0.01
#: Of a parameter, for differences, as part of its standard deviation before a calibration.
_STEP: Final = 1e-3
#: A number that ends farther off than this many of them has taken the place of something else.
_MOST_SIGMA: Final = 4.0
#: And so far off it is given up before the last round: at 10, a modulus is 0.
_LOST_SIGMA: Final = 9.0
#: Of the moduli and moments of a rod; of densities and masses of links that are known, as part of them, and
#: of those that are not: silicone and two links of the paper.
_SCALE: Final = 0.1
_KNOWN_MASS: Final = 0.05
_DENSITY_KG_M3: Final = 1100.0
_LINK_G: Final = 3.0
_NO_LINK_G: Final = 1e-6


class CalibrationError(ContidError):
    """The measurements do not determine the error of the model."""


class CompliantModel(Model, Compliant, Protocol):
    """A model that bends under a load."""


_LOOK_AT: Final = (
    "look at base (which way is down), the order of the axes, dimensions of the sections, the frame of the "
    "tracker and a forgotten load"
)


@dataclass(frozen=True, eq=False, slots=True)
class Family:
    """Models that differ by a few parameters; 0 is the robot file.

    Attributes:
        build: the model of parameters, shape ``(m,)``.
        sigma: standard deviation of each before a calibration.
        names: names of the parameters.
        units: unit of each; "" for a part of the whole.
        moduli: number of the parameters that are moduli, which come first; they creep.
    """

    build: Callable[[Array], CompliantModel]
    sigma: tuple[float, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    moduli: int = 0


def rod_family(robot: Cosserat) -> Family:
    """Rods with other moduli, moments and masses: parameters are those of `SectionErrors`, kind by kind.

    An arm whose file has no masses weighs something all the same; without them its weight would look like
    wrong moduli and moments.
    """
    sections = robot.geometry.sections
    count = len(sections)

    def build(parameters: Array) -> CompliantModel:
        return CosseratModel(scaled_arm(robot, SectionErrors.of(parameters.tolist(), count)))

    densities = [_KNOWN_MASS * each.density_kg_m3 or _DENSITY_KG_M3 for each in sections]
    links = [
        (_KNOWN_MASS * each.link_mass_g or _LINK_G) if each.link_mm > 0.0 else _NO_LINK_G for each in sections
    ]
    kinds = (("modulus", ""), ("moment", ""), ("density", "kg/m3"), ("link", "g"))
    return Family(
        build,
        (*(_SCALE,) * (2 * count), *densities, *links),
        tuple(f"s{i + 1}.{kind}" for kind, _ in kinds for i in range(count)),
        tuple(unit for _, unit in kinds for _ in range(count)),
        count,
    )


@dataclass(frozen=True, eq=False, slots=True)
class _Varied:
    """The models with one parameter after the other raised by a step."""

    models: tuple[CompliantModel, ...]
    steps: Array

    @classmethod
    def of(cls, family: Family, parameters: Array) -> _Varied:
        steps = _STEP * np.array(family.sigma)
        return cls(tuple(family.build(parameters + row) for row in np.diag(steps)), steps)


@dataclass(frozen=True, eq=False, slots=True)
class LoadCalibration:
    """The identified error of a model without load.

    Attributes:
        model: the one of the family that fits.
        parameters: values of the parameters of the family.
        middle: middle of the range of every axis [m or Pa], shape ``(k,)``.
        correction: for every axis its offset [m or Pa], its gain, half its loop [m or Pa]; shape ``(3k,)``.
        covariance: covariance of correction and parameters together.
        axis_sigma: standard deviation of the remaining error of an axis [m or Pa].
        tip_sigma_m: standard deviation of the tip that no axis and no tracker explains [m].
        residual_m: root mean square of what remains at the poses of the calibration [m].
        before_m: the same without a correction [m].
        poses: number of poses.
        family: that the model is of.
        creep: of the moduli; the model is for poses of `contid_fit.sense.creep.REFERENCE_S`.
    """

    model: CompliantModel
    parameters: Array
    middle: Array
    correction: Array
    covariance: Array
    axis_sigma: float
    tip_sigma_m: float
    residual_m: float
    before_m: float
    poses: int
    creep: Creep
    family: Family = field(repr=False)
    _varied: _Varied = field(repr=False)

    def corrected(self, actuation: Actuation, side: Actuation) -> Actuation:
        """The actuation for which the model meets the arm [m or Pa]."""
        q = np.array(actuation)
        return _tuple(q + _design(q, np.array(side), self.middle) @ self.correction)

    def aged(self, decades: float) -> CompliantModel:
        """The model of a pose of an age, in decades of `contid_fit.sense.creep.decades_of`."""
        if self.creep.per_decade * decades == 0.0:
            return self.model
        moduli = slice(self.family.moduli)
        softer = self.parameters.copy()
        softer[moduli] -= (1.0 + softer[moduli]) * self.creep.per_decade * decades
        return self.family.build(softer)

    def tip_covariance(
        self, actuation: Actuation, side: Actuation, load_n: Vec3, jacobian: Array, decades: float = 0.0
    ) -> Array:
        """Covariance of the tip by what the calibration left open, shape ``(3, 3)`` [m^2].

        Args:
            actuation: commanded [m or Pa].
            side: side of the hysteresis of every axis, -1 to 1, or NaN.
            load_n: force on the tip [N].
            jacobian: Jacobian of the model at the corrected actuation.
            decades: of the age of the pose.
        """
        corrected = self.corrected(actuation, side)
        by_axes = jacobian @ _design(np.array(actuation), np.array(side), self.middle)
        by_parameters = _by_parameters(self.model, self._varied, corrected, load_n)
        columns = np.hstack([by_axes, by_parameters])
        crept = self.creep.sigma * decades * by_parameters[:, : self.family.moduli].sum(axis=1)
        spread: Array = _spread(jacobian @ jacobian.T, self.axis_sigma, self.tip_sigma_m)
        spread += np.outer(crept, crept)
        loops = self.correction[2 * len(side) :]
        spread += columns @ self.covariance @ columns.T + _by_unknown(jacobian, np.array(side), loops)
        return spread


def calibrate_without_load(
    family: Family,
    actuations: Array,
    sides: Array,
    tips: Array,
    noise_m: float,
    drifts: Drifts | None = None,
) -> LoadCalibration:
    """Identify the error of a model from poses without load.

    Args:
        family: family of error models of the arm.
        actuations: commanded [m or Pa], shape ``(n, k)``; spread over the range.
        sides: side of the hysteresis of every axis, from `contid_fit.sense.play.HysteresisSides`,
            shape ``(n, k)``; NaN where it is not known.
        tips: measured tips in the base frame, averaged while the arm rests, shape ``(n, 3)`` [m].
        noise_m: standard deviation of such an averaged tip [m].
        drifts: how the tips drifted meanwhile; None for an arm that does not creep.

    Raises:
        CalibrationError: too few poses, or a number ends where nothing but another error can have moved it.
    """
    poses, axes = actuations.shape
    if poses < MIN_POSES_PER_AXIS * axes:
        raise CalibrationError(
            f"{poses} poses without load; at least {MIN_POSES_PER_AXIS * axes} are needed for {axes} axes"
        )
    scales = np.zeros(len(family.sigma))
    model = family.build(scales)
    lower, upper = np.array(model.lower), np.array(model.upper)
    middle, span = 0.5 * (lower + upper), upper - lower
    sigma = np.concatenate([_OFFSET * span, np.full(axes, _GAIN), _LOOP * span, family.sigma])
    prior = np.diag(1.0 / sigma**2)
    correction = np.zeros(3 * axes)
    axis_sigmas = float(span.mean()) * np.geomspace(1e-4, 0.1, 40)
    tip_sigmas = noise_m * np.array([1.0, 1.5, 2.0, 3.0, 5.0, 8.0])
    axis_sigma, tip_sigma, before_m = 0.0, 0.0, 0.0
    information = prior
    varied = _Varied((), np.zeros(0))
    errors = np.zeros((poses, 3))
    unknown = np.zeros((poses, 3, 3))
    creep = Creep()
    for round_ in range(_ROUNDS + 1):
        model, varied = family.build(scales), _Varied.of(family, scales)
        used = [
            _tuple(q + _design(q, side, middle) @ correction)
            for q, side in zip(actuations, sides, strict=True)
        ]
        errors = tips - np.array([model.forward(q).tip_m for q in used])
        slopes = np.array([_by_parameters(model, varied, q, ZERO3) for q in used])
        if drifts is not None:
            by_modulus = slopes[:, :, : family.moduli].sum(axis=2)
            creep = creep_of(by_modulus, drifts) if round_ else creep
            errors += creep.per_decade * drifts.decades[:, None] * by_modulus
        if round_ == 0:
            before_m = _rms(errors)
        if round_ == _ROUNDS:
            break
        jacobians = np.array([model.jacobian(q) for q in used])
        loops = correction[2 * axes :]
        unknown = np.array([_by_unknown(J, on, loops) for J, on in zip(jacobians, sides, strict=True)])
        products = jacobians @ jacobians.transpose(0, 2, 1)
        # Most likely spread of the errors under the corrections so far.
        axis_sigma, tip_sigma = max(
            ((float(a), float(t)) for a in axis_sigmas for t in tip_sigmas),
            key=lambda pair: _log_likelihood(errors, products, unknown, *pair),
        )
        information, right = prior.copy(), -prior @ np.concatenate([correction, scales])
        for q, side, by_parameters, error, jacobian, of_sides in zip(
            actuations, sides, slopes, errors, jacobians, unknown, strict=True
        ):
            columns = np.hstack([jacobian @ _design(q, side, middle), by_parameters])
            spread = _spread(jacobian @ jacobian.T, axis_sigma, tip_sigma) + of_sides
            weighted = columns.T @ np.linalg.inv(spread)
            information += weighted @ columns
            right += weighted @ error
        step = np.linalg.solve(information, right)
        correction, scales = correction + step[: 3 * axes], scales + step[3 * axes :]
        if not np.all(np.abs(np.concatenate([correction, scales])) <= _LOST_SIGMA * sigma):
            break  # refused below; no model bends with such numbers
    _refuse_far(family, model, correction, scales, sigma)
    if axis_sigma >= axis_sigmas[-1]:
        raise CalibrationError(
            f"the tips differ by {_rms(errors) * 1e3:.3g} mm (root mean square) from every model of the arm, "
            f"by {before_m * 1e3:.3g} mm from its file: what they measure is not what these axes move; "
            f"{_LOOK_AT}"
        )
    return LoadCalibration(
        model, scales, middle, correction, _inverse(information),
        axis_sigma, (tip_sigma**2 - noise_m**2) ** 0.5, _rms(errors), before_m, poses, creep, family, varied,
    )  # fmt: skip


def _design(q: Array, side: Array, middle: Array) -> Array:
    """Derivative of the corrected actuation by offsets, gains and loops, shape ``(k, 3k)``."""
    return np.hstack([np.eye(len(q)), np.diag(q - middle), np.diag(np.nan_to_num(side))])


def _by_unknown(jacobian: Array, side: Array, loops: Array) -> Array:
    """Covariance of the tip by the sides that are not known, shape ``(3, 3)`` [m^2]."""
    columns = jacobian * np.where(np.isnan(side), loops, 0.0)
    spread: Array = columns @ columns.T / 3.0
    return spread


def _refuse_far(
    family: Family, model: CompliantModel, correction: Array, parameters: Array, sigma: Array
) -> None:
    """Numbers far outside of what they may be stand for an error that no parameter has.

    Raises:
        CalibrationError: which, and by how many of their standard deviations.
    """
    of_axes = [f"{axis}.{what}" for what in ("offset", "gain", "loop") for axis in model.axis_names]
    found = np.abs(np.concatenate([correction, parameters])) / sigma
    far = [
        f"{name} {away:.1f}"
        for name, away in zip((*of_axes, *family.names), found.tolist(), strict=True)
        if not away <= _MOST_SIGMA
    ]
    if far:
        raise CalibrationError(
            f"the arm differs from its file by more than its parameters explain: {', '.join(far)} standard "
            f"deviations from the file, at most {_MOST_SIGMA:g} are credible; {_LOOK_AT}"
        )


def _by_parameters(model: CompliantModel, varied: _Varied, corrected: Actuation, load_n: Vec3) -> Array:
    """Derivative of the tip by the parameters of the family, shape ``(3, m)``."""
    here = np.array(model.forward(corrected, load_n).tip_m)
    moved = [np.array(each.forward(corrected, load_n).tip_m) - here for each in varied.models]
    return np.array(moved).reshape(-1, 3).T / varied.steps


def _spread(products: Array, axis_sigma: float, tip_sigma_m: float) -> Array:
    """Covariance of tips by errors of axes and tracker, ``(..., 3, 3)`` [m^2].

    ``products`` are those of Jacobians with their transposes, of the same shape.
    """
    spread: Array = axis_sigma**2 * products + tip_sigma_m**2 * np.eye(3)
    return spread


def _log_likelihood(
    errors: Array, products: Array, unknown: Array, axis_sigma: float, tip_sigma_m: float
) -> float:
    spreads = _spread(products, axis_sigma, tip_sigma_m) + unknown
    solved = np.linalg.solve(spreads, errors[:, :, None])[:, :, 0]
    return float(-0.5 * (np.linalg.slogdet(spreads)[1].sum() + (errors * solved).sum()))


def _inverse(matrix: Array) -> Array:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def _rms(errors: Array) -> float:
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


def _tuple(q: Array) -> Actuation:
    return tuple(q.tolist())
