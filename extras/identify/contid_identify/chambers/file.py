"""The file of a `ChamberMotion`: JSON with every number."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from contid.errors import ContidError
from contid_identify.chambers.motion import INFLATIONS, NUMBERS, Beginning, ChamberArm, ChamberMotion
from contid_identify.tip_motion import TipMotion
from contid_identify.tip_motion_file import (
    common_of,
    content_of,
    errors_of,
    remembered_in,
    step_in,
    tip_motion_of,
    write_numbers,
    write_tip_motion,
)

FORMAT: Final = "contid chamber motion 1"


def write_chamber_motion(model: ChamberMotion, path: Path) -> None:
    """Write the file, whole or not at all."""
    arm, begins = model.arm, model.begins
    data = {
        **common_of(model, FORMAT),
        "sections": [
            {
                "length_m": float(arm.length_m[k]),
                "link_m": float(arm.link_m[k]),
                "begins_rad": begins.bends[k].tolist(),
                **dict(zip(NUMBERS, model.numbers[k].tolist(), strict=True)),
            }
            for k in range(arm.sections)
        ],
        "section_of_axes": arm.section.tolist(),
        "directions": arm.directions.tolist(),
        "rest_pa": model.rest_pa,
        "span_pa": model.span_pa,
        "times_s": model.times_s.tolist(),
        "begins_share": begins.share,
        "begins_offset_m": begins.offset_m.tolist(),
        "high": model.high.tolist(),
        "apart": model.apart,
    }
    write_numbers(data, path)


def read_motion(path: str | Path) -> TipMotion | ChamberMotion:
    """Read a file of either model.

    Raises:
        ContidError: not such a file, or numbers of the wrong count.
    """
    data = content_of(path)
    return chamber_motion_of(data, path) if data.get("format") == FORMAT else tip_motion_of(data, path)


def write_motion(model: TipMotion | ChamberMotion, path: Path) -> None:
    """Write a file of either model, whole or not at all."""
    if isinstance(model, ChamberMotion):
        write_chamber_motion(model, path)
    else:
        write_tip_motion(model, path)


def chamber_motion_of(data: dict[str, Any], path: str | Path) -> ChamberMotion:
    """The model of the content of a file.

    Raises:
        ContidError: a key is missing, or numbers of the wrong count or range.
    """
    try:
        axes, sections = tuple(map(str, data["axes"])), data["sections"]

        def column(name: str) -> Any:
            return np.array([each[name] for each in sections], dtype=float)

        arm = ChamberArm(
            np.array(data["section_of_axes"], dtype=int), np.array(data["directions"], dtype=float),
            column("length_m"), column("link_m"),
        )  # fmt: skip
        begins = Beginning(
            column("begins_rad"), float(data["begins_share"]), np.array(data["begins_offset_m"], dtype=float)
        )
        model = ChamberMotion(
            str(data["robot"]), axes, arm, float(data["rest_pa"]), float(data["span_pa"]),
            np.array(data["times_s"], dtype=float), np.column_stack([column(name) for name in NUMBERS]),
            begins, np.array(data["high"], dtype=float), np.array(data["memory"], dtype=float),
            errors_of(data), str(data["source"]), remembered_in(data, INFLATIONS * len(axes)), step_in(data),
            int(data.get("apart", 0)),
        )  # fmt: skip
    except (KeyError, TypeError, ValueError) as error:
        raise ContidError(f"{path}: {error!r} where a number or a key should be; identify it anew") from None
    count, sections_count = len(axes), arm.sections
    shapes = {
        "section_of_axes": (arm.section, (count,)),
        "directions": (arm.directions, (count, 2)),
        "times_s": (model.times_s, (5,)),
        "begins_rad": (begins.bends, (sections_count, 2)),
        "begins_offset_m": (begins.offset_m, (3,)),
        "high": (model.high, (count,)),
        "sections": (model.numbers, (sections_count, len(NUMBERS))),
    }
    for name, (values, shape) in shapes.items():
        if values.shape != shape or not np.isfinite(values).all():
            raise ContidError(
                f"{path}: {name} has shape {values.shape} or numbers that are not finite; needed: {shape}; "
                "identify it anew"
            )
    positive = model.span_pa > 0.0 and (model.times_s > 0.0).all() and (column("longest_m") > 0.0).all()
    of_sections = sorted(set(arm.section.tolist())) == list(range(sections_count))
    if not (positive and of_sections and (column("side_m") > 0.0).all() and model.errors):
        raise ContidError(
            f"{path}: a time, span or length that is not above 0, a section without chambers, or no errors; "
            "identify it anew"
        )
    return model
