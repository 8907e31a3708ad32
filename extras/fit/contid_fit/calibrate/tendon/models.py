"""Models of a recording: pulls to tips, with derivatives by every parameter of the fit.

`LinearBends` is constant curvature whose bends are linear in all pulls; `ElasticBends` the least energy of
`contid_fit.calibrate.tendon.elastic`. Both end in the same chain of arcs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple, Protocol

import numpy as np

from contid.kinematics.array import Array
from contid_fit.calibrate.tendon.chain import Mounting, tips
from contid_fit.calibrate.tendon.elastic import Elastic, play_rows, pull_matrix, series
from contid_fit.calibrate.tendon.parameters import Group, Parameters, group

#: Standard deviations of what is expected of a robot before the data: mounting and manufacture.
LENGTH_SPREAD_M: Final = 5e-3
BASE_SPREAD_M: Final = 5e-3
TILT_SPREAD_RAD: Final = 0.03
MARKER_SPREAD_M: Final = 3e-3
RADIUS_SPREAD: Final = 0.1
ANGLE_SPREAD_RAD: Final = 0.3
OFFSET_SPREAD_M: Final = 0.3e-3
REST_SPREAD_RAD: Final = 0.05
LOG_SPREAD: Final = 1.0
TWIST_SPREAD_RAD: Final = 0.1
#: Expected bending stiffness E I / (L k), with k the stiffness of a tendon, and friction, both over the
#: square of the radius; play [m]; hardening [1/m].
STIFFNESS: Final = 0.3
FRICTION: Final = 0.01
PLAY_M: Final = 0.03e-3
HARDENING_PER_M: Final = 300.0
#: Stands for 0 where the logarithm of a quantity is the parameter.
NONE: Final = 1e-12
MOUNTING: Final = ("length_m", "base_m", "tilt_rad", "marker_m")


class Nominal(NamedTuple):
    """What is known of a robot before the fit.

    Attributes:
        length_m: length of each section.
        radius_m: distance from the backbone of all tendons.
        angle_rad: azimuth of each tendon, from section 1 on.
        tendons: number of tendons of each section.
        base_m: start of section 1 in the frame of the recording.
        through: tendons run through the sections before their own; else sheaths carry them.
    """

    length_m: tuple[float, ...]
    radius_m: float
    angle_rad: Array
    tendons: tuple[int, ...]
    base_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    through: bool = True

    @property
    def tendon_names(self) -> tuple[str, ...]:
        """``s1.t1``, ``s1.t2`` and so on."""
        return tuple(f"s{s + 1}.t{t + 1}" for s, n in enumerate(self.tendons) for t in range(n))

    @property
    def section_names(self) -> tuple[str, ...]:
        """``s1``, ``s2`` and so on."""
        return tuple(f"s{s + 1}" for s in range(len(self.tendons)))

    @property
    def passing_names(self) -> tuple[str, ...]:
        """``s2/s1``, ``s3/s1``, ``s3/s2`` and so on: tendons of one section in another before it."""
        sections = len(self.tendons) if self.through else 0
        return tuple(f"s{j + 1}/s{k + 1}" for j in range(sections) for k in range(j))

    @property
    def bend_names(self) -> tuple[str, ...]:
        """``s1.x``, ``s1.y`` and so on."""
        return tuple(f"{name}.{axis}" for name in self.section_names for axis in "xy")


class Prediction(NamedTuple):
    """Predicted tips ``(rows, 3)`` [m], derivatives ``(rows, 3, parameters)``, features ``(rows, any)``."""

    tip_m: Array
    by: Array
    features: Array


class RecordingModel(Protocol):
    """Pulls to tips."""

    @property
    def parameters(self) -> Parameters:
        """What is fitted."""

    def rows(self, vector: Array, pull_m: Array) -> Prediction:
        """The tips of pulls ``(rows, tendons)`` in the order of time."""


def _mounting_groups(nominal: Nominal, offsets: bool) -> list[Group]:
    if not offsets:
        return []
    return [
        group("length_m", nominal.section_names, nominal.length_m, LENGTH_SPREAD_M),
        group("base_m", "xyz", nominal.base_m, BASE_SPREAD_M),
        group("tilt_rad", "xy", 0.0, TILT_SPREAD_RAD),
        group("marker_m", "xy", 0.0, MARKER_SPREAD_M),
    ]


def _through_chain(
    nominal: Nominal, parameters: Parameters, values: dict[str, Array], bends: Array, by: dict[str, Array]
) -> tuple[Array, Array]:
    """Tips of bends, and their derivatives by all parameters from those of the bends."""
    mounting = Mounting(
        values.get("base_m", np.array(nominal.base_m)),
        values.get("tilt_rad", np.zeros(2)),
        values.get("marker_m", np.zeros(2)),
    )
    chain = tips(bends, values.get("length_m", np.array(nominal.length_m)), mounting)
    own = dict(zip(MOUNTING, (chain.by_length, chain.by_base, chain.by_tilt, chain.by_marker), strict=True))
    columns = [
        own[each.name] if each.name in own else chain.by_bend @ by[each.name] for each in parameters.groups
    ]
    return chain.tip_m, np.concatenate(columns, axis=2)


@dataclass(frozen=True, eq=False)
class LinearBends:
    """Constant curvature with bends linear in all pulls, ``Theta = A pulls (+ rest)``.

    Attributes:
        nominal: the robot; the expected A is the least squares of its geometry.
        offsets: also fit lengths, rest bends, and the mounting of robot and marker.
        with_play: pulls reach the backbone through play, of one half width per section.
    """

    nominal: Nominal
    offsets: bool = False
    with_play: bool = False

    @cached_property
    def parameters(self) -> Parameters:
        """The prior of A is that of the geometry, with a standard deviation as large as its elements."""
        nominal = self.nominal
        tendons = len(nominal.tendon_names)
        radii = np.full(tendons, nominal.radius_m)
        matrix = np.linalg.pinv(pull_matrix(nominal.tendons, radii, nominal.angle_rad, nominal.through))
        names = [f"{bend}/{tendon}" for bend in nominal.bend_names for tendon in nominal.tendon_names]
        groups = [group("gain_per_m", names, np.asarray(matrix.ravel()), 1.0 / nominal.radius_m)]
        groups += _mounting_groups(nominal, self.offsets)
        if self.offsets:
            groups.append(group("rest_rad", nominal.bend_names, 0.0, REST_SPREAD_RAD))
        if self.with_play:
            groups.append(group("log_play", nominal.section_names, math.log(PLAY_M), LOG_SPREAD))
        return Parameters(tuple(groups))

    def rows(self, vector: Array, pull_m: Array) -> Prediction:
        """The tips of pulls ``(rows, tendons)``."""
        nominal, values = self.nominal, self.parameters.split(vector)
        size = 2 * len(nominal.section_names)
        matrix = values["gain_per_m"].reshape(size, -1)
        section = np.repeat(np.arange(len(nominal.tendons)), nominal.tendons)
        by: dict[str, Array] = {}
        if "log_play" in values:
            width = np.exp(values["log_play"])[section]
            arrived, slopes = play_rows(pull_m, width)
            own = section[:, None] == np.arange(len(nominal.tendons))
            by["log_play"] = matrix @ ((slopes * width)[:, :, None] * own)
        else:
            arrived = pull_m
        bends = arrived @ matrix.T + values.get("rest_rad", np.zeros(size))
        by["gain_per_m"] = np.asarray(np.kron(np.eye(size), arrived[:, None, :]), dtype=np.float64)
        by["rest_rad"] = np.broadcast_to(np.eye(size), (len(pull_m), size, size))
        tip, jacobian = _through_chain(nominal, self.parameters, values, bends, by)
        return Prediction(tip, jacobian, np.hstack((bends, arrived)))


@dataclass(frozen=True, eq=False)
class ElasticBends:
    """The least energy of backbone and tendons that never push; with or without dry friction and play.

    Attributes:
        nominal: the robot before the fit.
        friction: also fit dry friction and play; else both are 0.
    """

    nominal: Nominal
    friction: bool = True

    @cached_property
    def parameters(self) -> Parameters:
        """Geometry, offsets, stiffness and rest, friction and play, mounting."""
        nominal = self.nominal
        d = nominal.radius_m
        groups = [
            group("radius_m", nominal.tendon_names, d, RADIUS_SPREAD * d),
            group("angle_rad", nominal.tendon_names, nominal.angle_rad, ANGLE_SPREAD_RAD),
            group("twist_rad", nominal.passing_names, 0.0, TWIST_SPREAD_RAD),
            group("log_hardening", ("all",), math.log(HARDENING_PER_M), LOG_SPREAD),
            group("offset_m", nominal.tendon_names, 0.0, OFFSET_SPREAD_M),
            group("log_stiffness", nominal.section_names, math.log(STIFFNESS * d * d), LOG_SPREAD),
            group("rest_rad", nominal.bend_names, 0.0, REST_SPREAD_RAD),
        ]
        if self.friction:
            log_friction = math.log(FRICTION * d * d)
            groups.append(group("log_friction", nominal.section_names, log_friction, LOG_SPREAD))
            groups.append(group("log_play", nominal.section_names, math.log(PLAY_M), LOG_SPREAD))
        return Parameters((*groups, *_mounting_groups(nominal, True)))

    def elastic(self, vector: Array) -> Elastic:
        """The robot that a vector describes."""
        values = self.parameters.split(vector)
        none = np.full(len(self.nominal.tendons), math.log(NONE))
        return Elastic(
            self.nominal.tendons,
            values["radius_m"],
            values["angle_rad"],
            values["twist_rad"],
            float(np.exp(values["log_hardening"][0])),
            values["offset_m"],
            np.exp(values["log_stiffness"]),
            values["rest_rad"],
            np.exp(values.get("log_friction", none)),
            np.exp(values.get("log_play", none)),
            self.nominal.through,
        )

    def rows(self, vector: Array, pull_m: Array) -> Prediction:
        """The tips of pulls ``(rows, tendons)``; features are bends and tensions over stiffness [m]."""
        nominal, values = self.nominal, self.parameters.split(vector)
        found = series(self.elastic(vector), pull_m)
        tip, jacobian = _through_chain(nominal, self.parameters, values, found.bends, found.by)
        return Prediction(tip, jacobian, np.hstack((found.bends, np.maximum(found.elongation_m, 0.0))))
