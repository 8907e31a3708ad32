"""The stages of a calibration, each judged on rows that were kept out.

Constant curvature, linear in all pulls; + offsets; + play; statics (least energy, tendons that never push);
+ friction; + residual. All stages see the same training rows and predict the rows kept out from the pulls
alone, starting from the state in which the training rows left the robot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from contid.kinematics.array import Array
from contid_fit.calibrate.tendon.accuracy import Accuracy, accuracy
from contid_fit.calibrate.tendon.fit import TendonFit, fit_model
from contid_fit.calibrate.tendon.models import ElasticBends, LinearBends, Nominal, RecordingModel
from contid_fit.calibrate.tendon.recording import TendonRecording
from contid_fit.calibrate.tendon.residual import Residual, fit_residual

FRICTION_STAGE: Final = "+ friction, play"
STAGES: Final[tuple[tuple[str, Callable[[Nominal], RecordingModel]], ...]] = (
    ("constant curvature", LinearBends),
    ("+ offsets", lambda nominal: LinearBends(nominal, offsets=True)),
    ("+ play", lambda nominal: LinearBends(nominal, offsets=True, with_play=True)),
    ("statics", lambda nominal: ElasticBends(nominal, friction=False)),
    (FRICTION_STAGE, ElasticBends),
)
RESIDUAL_STAGE: Final = "+ residual"


@dataclass(frozen=True, eq=False)
class Stage:
    """One stage and its errors.

    Attributes:
        name: what it adds.
        fit: the model; that of the stage before for the residual.
        residual: the correction, in the last stage.
        train, held_out: errors on the rows of the fit and on those kept out; None without such rows.
        tip_m: predicted tips of all rows, training rows first.
    """

    name: str
    fit: TendonFit
    residual: Residual | None
    train: Accuracy
    held_out: Accuracy | None
    tip_m: Array


def run_stages(
    training: TendonRecording, held_out: TendonRecording | None, nominal: Nominal
) -> Iterator[Stage]:
    """Fit one stage after the other; ``held_out`` follows the training rows in time."""
    both = training if held_out is None else training.followed_by(held_out)
    split = len(training)
    stage: Stage | None = None
    for name, build in STAGES:
        fit = fit_model(build(nominal), training, start=_from_before(build(nominal), stage))
        stage = _judged(name, fit, None, fit.rows(both.pull_m).tip_m, both, split)
        yield stage
    if stage is not None:
        rows = stage.fit.rows(both.pull_m)
        missing = (both.tip_m - rows.tip_m)[:split]
        bends = 2 * len(nominal.tendons)
        residual = fit_residual(rows.features[:split], missing, both.runs[:split], bends)
        tip = rows.tip_m + residual.correction(rows.features)
        yield _judged(RESIDUAL_STAGE, stage.fit, residual, tip, both, split)


def _from_before(model: RecordingModel, stage: Stage | None) -> Array | None:
    """Start where the stage before ended, if it was of the same kind."""
    if stage is None or type(stage.fit.model) is not type(model):
        return None
    return model.parameters.moved(stage.fit.model.parameters.split(stage.fit.vector)).expected


def _judged(
    name: str, fit: TendonFit, residual: Residual | None, tip: Array, both: TendonRecording, split: int
) -> Stage:
    error, runs = tip - both.tip_m, both.runs
    train = accuracy(error[:split], runs[:split])
    kept = accuracy(error[split:], runs[split:]) if split < len(both) else None
    return Stage(name, fit, residual, train, kept, tip)


def split_rows(recording: TendonRecording, share: float) -> tuple[TendonRecording, TendonRecording | None]:
    """The first rows to fit and the last ``share`` of the rows to keep out."""
    first = len(recording) - round(share * len(recording))
    if first == len(recording):
        return recording, None
    return recording.rows(0, first), recording.rows(first, len(recording))
