"""Tracks until the images end: measures, writes rows, sends, draws."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import cv2

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.units import MM_PER_M
from contid_camera.overlay import drawn
from contid_camera.refusals import Refusals
from contid_camera.setup_file import LoadedSetup
from contid_camera.tracker import MeasuredTip, TipTracker

#: Least time between two writes of the overlay [s], by the times of the images.
OVERLAY_S: Final = 0.5
#: ``ax,ay,az`` is the unit vector of the body's direction at the tip, in the world.
HEADER: Final = "t_s,x_mm,y_mm,z_mm,ax,ay,az,sd_mm,error_px"


@dataclass(slots=True)
class TrackReport:
    """What became of the images.

    Attributes:
        images: looked at.
        measured: number of images with a tip.
        refusals: of the others.
        work_s: processor time of looking.
    """

    images: int = 0
    measured: int = 0
    refusals: Refusals = field(default_factory=Refusals)
    work_s: float = 0.0

    def __str__(self) -> str:
        """One line, and one for each reason."""
        per_s = self.images / self.work_s if self.work_s else 0.0
        lines = [
            f"{self.measured} of {self.images} images measured; {per_s:.0f} a second on one core possible"
        ]
        return "\n".join([*lines, *self.refusals.lines()])


def track(
    loaded: LoadedSetup,
    images: Iterable[tuple[Array, float]],
    taken: Callable[[MeasuredTip], None],
    overlay: Path | None = None,
    report: TrackReport | None = None,
) -> TrackReport:
    """Measure the tip in images, until they end.

    Args:
        loaded: setup and camera.
        images: grey images with their times [s].
        taken: gets every measured tip.
        overlay: image that is rewritten now and then, None for none.
        report: is counted in, and is there when this ends by an exception; None for a new one.

    Raises:
        ContidError: images of another size than the camera's; the overlay cannot be written.
    """
    # With one thread the processor time is the time on one core, which the report is about.
    cv2.setNumThreads(1)
    report = TrackReport() if report is None else report
    tracker, drawn_s = TipTracker(loaded), -math.inf
    width, height = loaded.camera.size_px
    for image, time_s in images:
        if image.shape != (height, width):
            size = f"{image.shape[1]} x {image.shape[0]}"
            raise ContidError(f"images of {size} pixels; the camera was calibrated with {width} x {height}")
        begin_s = time.process_time()
        look = tracker.look(image, time_s)
        report.work_s += time.process_time() - begin_s
        report.images += 1
        if look.tip is None:
            report.refusals.add(look.refusal)
        else:
            report.measured += 1
            taken(look.tip)
        if overlay is not None and time_s - drawn_s >= OVERLAY_S:
            drawn_s = time_s
            _write(overlay, drawn(image, look, loaded.camera))
    return report


def row(tip: MeasuredTip) -> str:
    """A row under `HEADER`."""
    values = [value * MM_PER_M for value in tip.tip_m]
    numbers = [*(f"{value:.4f}" for value in values), *(f"{value:.6f}" for value in tip.direction)]
    return f"{tip.time_s:.6f},{','.join(numbers)},{tip.tip_sd_m * MM_PER_M:.4f},{tip.error_px:.3f}"


def _write(path: Path, image: Array) -> None:
    """Replace the file at once, so that a viewer never reads half of it."""
    new = path.with_name(f".{path.stem}.new{path.suffix}")
    try:
        if not cv2.imwrite(str(new), image):
            raise ContidError(f"{path}: cannot be written")
        new.replace(path)
    except (ContidError, OSError, cv2.error) as error:
        with suppress(OSError):  # what a full disk left
            new.unlink()
        if isinstance(error, ContidError):
            raise
        raise ContidError(f"{path}: cannot be written: {error}") from None
