"""The capstan coefficient that takes as much work as the dry friction of a fit.

The fit has a moment of friction F per section, which a recording without forces shows well; the robot file
has the coefficient mu of its tendons, of which the control loop computes the tensions to command. Over the
rows of the recording both take the same work:

    sum F_k |Theta_k - before| = mu sum |Theta_k| T_i |slid_ik|,

T the tension of tendon i, slid_ik what it slides in the middle of section k. Everything is divided by the
stiffness of a tendon.
"""

from __future__ import annotations

import numpy as np

from contid.kinematics.array import Array
from contid_fit.calibrate.tendon.ends import CapstanCoefficient, capstan_from_ends
from contid_fit.calibrate.tendon.fit import TendonFit
from contid_fit.calibrate.tendon.models import ElasticBends
from contid_fit.calibrate.tendon.recording import TendonRecording


def measured_capstan(fit: TendonFit, data: TendonRecording) -> CapstanCoefficient | None:
    """The coefficient from load cells at both ends, in the bends of a fit; None without such cells."""
    model = fit.model
    if data.ends_n is None or not isinstance(model, ElasticBends):
        return None
    count = len(model.nominal.tendons)
    bends = model.rows(fit.vector, data.pull_m).features[:, : 2 * count].reshape(-1, count, 2)
    passes = np.any(model.elastic(fit.vector).pull_matrix.reshape(-1, count, 2) != 0.0, axis=2)
    turned_rad = np.hypot(bends[..., 0], bends[..., 1]) @ passes.T
    return capstan_from_ends(turned_rad, data.pull_m, data.ends_n, data.runs)


def capstan_coefficient(fit: TendonFit, pull_m: Array) -> CapstanCoefficient | None:
    """The coefficient of a fit over the rows ``(rows, tendons)`` it was fitted to; None without friction."""
    model = fit.model
    if not isinstance(model, ElasticBends) or not model.friction or len(pull_m) < 2:
        return None
    nominal, elastic = model.nominal, model.elastic(fit.vector)
    count = len(nominal.tendons)
    features = model.rows(fit.vector, pull_m).features
    bends, stretch = np.split(features, (2 * count,), axis=1)
    tension = 0.5 * (stretch[1:] + stretch[:-1])
    tension = tension + elastic.hardening_per_m * tension**2
    pairs = bends.reshape(len(bends), count, 2)
    turned = np.hypot(pairs[..., 0], pairs[..., 1])
    change = np.diff(pairs, axis=0)
    arms = elastic.pull_matrix.reshape(-1, count, 2)
    taken = np.einsum("ikc,rkc->rik", arms, change)
    beyond = np.cumsum(taken[:, :, ::-1], axis=2)[:, :, ::-1] - 0.5 * taken
    passes = np.any(arms != 0.0, axis=2)
    middle = 0.5 * (turned[1:] + turned[:-1])
    work = float(np.sum(np.abs(beyond) * passes * tension[:, :, None] * middle[:, None, :]))
    per_section = np.abs(np.hypot(change[..., 0], change[..., 1])).sum(axis=0)
    if not work > 0.0:
        return None
    half = model.parameters.split(fit.half_width)["log_friction"]
    ends = (elastic.friction_m2 * np.exp(np.minimum(side * half, 50.0)) for side in (0.0, -1.0, 1.0))
    return CapstanCoefficient(*(float(each @ per_section) / work for each in ends))
