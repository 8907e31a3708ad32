"""The force on a tip, estimated from actuations and a measured tip."""

from contid_fit.sense.calibration import (
    CalibrationError,
    Family,
    LoadCalibration,
    calibrate_without_load,
    rod_family,
)
from contid_fit.sense.estimator import LoadEstimate, LoadEstimator
from contid_fit.sense.play import HysteresisSides

__all__ = [
    "CalibrationError",
    "Family",
    "HysteresisSides",
    "LoadCalibration",
    "LoadEstimate",
    "LoadEstimator",
    "calibrate_without_load",
    "rod_family",
]
