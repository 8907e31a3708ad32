"""Recordings for the tests of the tendon calibration."""

from __future__ import annotations

from pathlib import Path

from contid.calibrate.tendon.recording import TendonRecording, read_recording

#: 466 of 1620 rows of one robot's identification data (MIT licence beside it).
EXCERPT = Path(__file__).parent.parent / "reference" / "tendon" / "ftdcr_v4-excerpt.csv"
#: Sections of that robot [m], and the number of rows before its pairs of sections.
LENGTH_M = (0.060, 0.0625, 0.064)
RADIUS_M = 4.5e-3
COUNT = (3, 3, 3)


def excerpt() -> TendonRecording:
    with EXCERPT.open(encoding="utf-8") as lines:
        return read_recording(lines, EXCERPT.name)


def rows_before_pairs(recording: TendonRecording) -> int:
    return next(i for i, label in enumerate(recording.pattern) if "pair" in label)
