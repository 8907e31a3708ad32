"""What ``contid calibrate tendon --json`` prints."""

from __future__ import annotations

import json
import math

import numpy as np

from contid_fit.calibrate.tendon.accuracy import Accuracy
from contid_fit.calibrate.tendon.fit import TendonFit
from contid_fit.calibrate.tendon.geometry import find_geometry
from contid_fit.calibrate.tendon.models import ElasticBends, Nominal
from contid_fit.calibrate.tendon.recording import TendonRecording
from contid_fit.calibrate.tendon.stages import Stage
from contid_fit.commands.tendon import _numbers


def test_one_section_alone_gives_valid_json() -> None:
    """There is no other section a servo could belong to: no finite margin."""
    angles = np.array([0.0, 2.0, 4.0])
    pull_m, tip_m = np.full((12, 3), -3e-3), np.zeros((12, 3))
    for k in range(12):
        pull_m[k, k // 4] = 1e-3 * (1 + k % 4)
        tip_m[k, :2] = 5.0 * pull_m[k, k // 4] * np.array([np.cos(angles[k // 4]), np.sin(angles[k // 4])])
    both = TendonRecording("r", ("a",) * 12, ("1", "2", "3"), pull_m, tip_m)
    geometry = find_geometry(both, (3,))
    assert geometry is not None
    assert geometry.margin == math.inf
    model = ElasticBends(Nominal((0.1,), 4e-3, angles, (3,)))
    vector = model.parameters.expected
    fit = TendonFit(model, vector, 0.1 * model.parameters.spread, 1, True)
    stage = Stage("s", fit, None, Accuracy(1.0, 1.0, (1.0, 1.0), (1.0, 1.0), 12), None, tip_m)
    text = json.dumps(_numbers(geometry, both, (stage,)))
    assert json.loads(text, parse_constant=lambda name: name)["geometry_margin"] is None
