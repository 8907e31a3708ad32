"""Recordings for the tests of the tendon calibration."""

from __future__ import annotations

import io
import re
from typing import Final

from contid.calibrate.tendon.recording import TendonRecording, read_recording
from tests.support.shared_data import shared_data

#: Of 48 patterns all pulls of one tendon, nine of one section and three pairs of sections: 466 of 1620 rows.
PATTERNS: Final = re.compile(
    r"rep1_(tendon\d_id\d_pull|seg\d_dir(0|120|240)|pair12_same_dir60|pair13_opp_dir0|pair23_same_dir180)(_hold)?"
)
#: Sections of that robot [m].
LENGTH_M = (0.060, 0.0625, 0.064)
RADIUS_M = 4.5e-3
COUNT = (3, 3, 3)


def excerpt_lines() -> list[str]:
    """Head and rows of an excerpt of the identification data of ftdcr_v4; pairs of sections come last."""
    head, *rows = shared_data("tendon/ftdcr_v4/train.csv").read_text(encoding="utf-8").splitlines()
    return [head, *(row for row in rows if PATTERNS.fullmatch(row.split(",")[1]))]


def excerpt() -> TendonRecording:
    return read_recording(io.StringIO("\n".join(excerpt_lines())), "train.csv")


def rows_before_pairs(recording: TendonRecording) -> int:
    return next(i for i, label in enumerate(recording.pattern) if "pair" in label)
