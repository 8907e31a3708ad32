"""The file of a `TipMotion`: JSON with every number, which `contid predict` and programs read."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, Final

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.whole_file import replacing
from contid_identify.remembered import RememberedMotion
from contid_identify.sections.bent import BentSections
from contid_identify.sections.play import NO_PLAY, AxisPlay
from contid_identify.tip_motion import (
    AGES,
    OLD_STEP_S,
    AheadError,
    MovingTip,
    SwingHalves,
    TipMotion,
    features,
)

_FORMAT: Final = "contid tip motion 1"
_VECTORS: Final = ("delay_s", "frequency_hz", "ratio", "centre", "low", "high", "memory")
_REMEDY: Final = "`contid identify ROBOT SESSION --motion FILE` writes one"
_REMEMBERED: Final = ("scale", "centres", "loads", "weights")
_HALVES: Final = ("delay_s", "frequency", "ratio")
_MATRICES: Final = ("turns", "weights", "load_weights")


def write_tip_motion(model: TipMotion, path: Path) -> None:
    """Write the file, whole or not at all."""
    data: dict[str, Any] = {
        **common_of(model, _FORMAT),
        "degree": model.degree,
        "play": model.play._asdict(),
        "near": numbers_of(model.near),
        "softer_per_kg": model.softer_per_kg,
        "less_per_kg": model.less_per_kg,
        "loads_kg": list(model.loads_kg),
        "halves": {
            name: half if math.isfinite(half := getattr(model.halves, name)) else None for name in _HALVES
        },
    }
    for name in (*_VECTORS, *_MATRICES):
        data[name] = getattr(model, name).tolist()
    if model.bent is not None:
        data["bent"] = {each.name: getattr(model.bent, each.name).tolist() for each in fields(BentSections)}
    write_numbers(data, path)


def common_of(model: MovingTip, form: str) -> dict[str, Any]:
    """What files of every model have."""
    return {
        "format": form,
        "robot": model.robot,
        "axes": list(model.axes),
        "source": model.source,
        "errors": [
            # Infinity is no number of JSON, and what was not judged has none.
            {name: value if math.isfinite(value) else None for name, value in asdict(each).items()}
            for each in model.errors
        ],
        "memory": model.memory.tolist(),
        "memory_step_s": model.memory_step_s,
        "remembered": numbers_of(model.remembered),
    }  # fmt: skip


def numbers_of(kept: RememberedMotion | None) -> dict[str, Any] | None:
    """The numbers of what is added to a map."""
    return {name: getattr(kept, name).tolist() for name in _REMEMBERED} if kept is not None else None


def step_in(data: dict[str, Any]) -> float:
    """Between two errors of the memory [s]."""
    step_s = float(data.get("memory_step_s", OLD_STEP_S))
    if not 1e-3 <= step_s <= 1.0:
        raise ValueError(f"memory_step_s {step_s}, not 0.001 to 1")
    return step_s


def remembered_in(data: dict[str, Any], states: int, key: str = "remembered") -> RememberedMotion | None:
    """What is remembered in a file; ``states``: number of those it is remembered by.

    Raises:
        ValueError: numbers of another shape.
    """
    kept = data.get(key)
    if not kept:
        return None
    found = RememberedMotion(*(np.array(kept[name], dtype=float) for name in _REMEMBERED))
    count = len(found.loads)
    needed = ((states,), (count, states), (count,), (count, 3))
    if tuple(getattr(found, name).shape for name in _REMEMBERED) != needed:
        raise ValueError(f"{key} has numbers of another shape than {needed}")
    return found


def errors_of(data: dict[str, Any]) -> tuple[AheadError, ...]:
    """The errors in a file."""
    return tuple(
        AheadError(
            float("inf") if each["ahead_s"] is None else float(each["ahead_s"]),
            *(float("nan") if each[name] is None else float(each[name]) for name in ("rmse_m", "radius_m")),
        )
        for each in data["errors"]
    )  # fmt: skip


def write_numbers(data: dict[str, Any], path: Path) -> None:
    """Write a file, whole or not at all."""
    with replacing(path) as file:
        file.write((json.dumps(data, indent=1) + "\n").encode())


def content_of(path: str | Path) -> dict[str, Any]:
    """The content of a file.

    Raises:
        ContidError: not such a file.
    """
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ContidError(f"{path}: no file of a tip in motion ({error}); {_REMEDY}") from None
    if not isinstance(data, dict):
        raise ContidError(f"{path}: its `format` is not {_FORMAT!r}; {_REMEDY}")
    return data


def read_tip_motion(path: str | Path) -> TipMotion:
    """Read the file.

    Raises:
        ContidError: not such a file, or numbers of the wrong count.
    """
    return tip_motion_of(content_of(path), path)


def tip_motion_of(data: dict[str, Any], path: str | Path) -> TipMotion:
    """The model of the content of a file.

    Raises:
        ContidError: another file, or numbers of the wrong count.
    """
    if data.get("format") != _FORMAT:
        raise ContidError(f"{path}: its `format` is not {_FORMAT!r}; {_REMEDY}")
    try:
        axes = tuple(map(str, data["axes"]))
        vectors = {name: np.array(data[name], dtype=float) for name in _VECTORS}
        matrices = {name: np.array(data[name], dtype=float) for name in _MATRICES}
        degree = int(data["degree"])
        low_kg, high_kg = map(float, data["loads_kg"])
        # Files of before have no play and no intervals, and nothing is remembered.
        play = AxisPlay(**{name: float(value) for name, value in data.get("play", NO_PLAY._asdict()).items()})
        given = data.get("halves", {})
        halves = SwingHalves(*(math.inf if (v := given.get(k)) is None else float(v) for k in _HALVES))
        bent = _bent_in(data, len(axes), len(matrices["turns"]))
        near = None if bent is None else remembered_in(data, 2 * len(bent.length_m), "near")
        model = TipMotion(
            str(data["robot"]), axes, softer_per_kg=float(data["softer_per_kg"]), degree=degree,
            less_per_kg=float(data["less_per_kg"]),
            loads_kg=(low_kg, high_kg), errors=errors_of(data), source=str(data["source"]), halves=halves,
            remembered=remembered_in(data, AGES * len(matrices["turns"])), memory_step_s=step_in(data),
            bent=bent, near=near, play=play, **vectors, **matrices,
        )  # fmt: skip
    except (KeyError, TypeError, ValueError) as error:
        raise ContidError(f"{path}: {error!r} where a number or a key should be; {_REMEDY}") from None
    _check(model, path)
    return model


def _bent_in(data: dict[str, Any], axes: int, inputs: int) -> BentSections | None:
    """The bends of sections in a file.

    Raises:
        ValueError: numbers of another shape, or not finite.
    """
    kept = data.get("bent")
    if not kept:
        return None
    found = BentSections(
        **{each.name: np.array(kept[each.name], dtype=float) for each in fields(BentSections)}
    )
    count = len(found.length_m)
    needed: dict[str, tuple[int, ...]] = {
        "length_m": (count,), "link_m": (count,), "base_m": (3,), "frame": (3, 3),
        "axes_by_inputs": (axes, inputs),
        "gains": (axes, count, 2), "cubes": (axes,), "rest": (count, 2), "braced": (count, count, count),
        "softer": (count, count), "sag": (count, 2), "cube_halves": (axes,),
        "braced_halves": (count, count, count),
    }  # fmt: skip
    for name, shape in needed.items():
        values: Array = getattr(found, name)
        # Only an interval may be unknown, which is infinite.
        if values.shape != shape or not (np.isfinite(values).all() or "halves" in name):
            raise ValueError(f"bent.{name} has shape {values.shape} or numbers that are not finite")
    return found


def _check(model: TipMotion, path: str | Path) -> None:
    inputs = len(model.low)
    if not 1 <= model.degree <= 3:
        raise ContidError(f"{path}: degree is {model.degree}; allowed: 1 to 3")
    monomials = features(np.zeros((1, inputs)), model.low, model.low, model.degree).shape[1]
    shapes: dict[str, tuple[int, ...]] = {
        **dict.fromkeys(("delay_s", "frequency_hz", "ratio", "centre"), (len(model.axes),)),
        "high": (inputs,),
        "memory": (len(model.memory),),
        "turns": (inputs, len(model.axes)),
        "weights": (monomials, 3),
        "load_weights": (monomials, 3),
    }
    for name, shape in shapes.items():
        values: Array = getattr(model, name)
        if values.shape != shape or not np.isfinite(values).all():
            raise ContidError(
                f"{path}: {name} has shape {values.shape} or numbers that are not finite; needed: {shape}; "
                f"{_REMEDY}"
            )
    if not (0.0 <= model.play.half < math.inf and 0.0 <= model.play.share < 1.0):
        raise ContidError(
            f"{path}: play is {model.play._asdict()}; half is 0 or more, share from 0 to below 1; {_REMEDY}"
        )
    if not model.errors or not (model.frequency_hz > 0.0).all():
        raise ContidError(f"{path}: no errors, or a frequency that is not above 0; {_REMEDY}")
