"""Sessions as a LeRobot dataset, layout v3.0 (huggingface.co/docs/lerobot), an episode per session.

``observation.state`` are the measured axes, ``action`` the commanded ones, ``observation.tip`` the tips by
forward kinematics of the measured axes: float32, in mm and bar, of all robots of the file. Frames are ticks
that ran; an episode begins and ends where every command and every measured axis has a value.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from contid.errors import ContidError
from contid.session.read import Session
from contid_sessions.episode import Episode, feature_names, read_episode

_VERSION: Final = "v3.0"
_DATA: Final = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
#: Files of a folder.
_CHUNK: Final = 1000
_QUANTILES: Final = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
#: Columns of LeRobot's own.
_OWN: Final = ("frame_index", "episode_index", "index", "task_index")


def export_lerobot(
    sessions: Sequence[Session], folder: Path, task: str, fps: int | None = None
) -> list[Episode]:
    """Write a dataset; a folder that exists is never changed.

    Args:
        sessions: sessions of robots with the same axes and rates.
        folder: path of the dataset.
        task: what the robots do, in a sentence; the same for all episodes.
        fps: frames per second, a divisor of the rate; every tick when left out.

    Raises:
        ContidError: sessions differ, a rate does not fit, or the folder cannot be written.
    """
    import pyarrow as pa
    from pyarrow import parquet

    if folder.exists():
        raise ContidError(f"{folder}: exists; datasets are never overwritten")
    step, fps = _step(sessions, fps)
    names = [feature_names(session) for session in sessions]
    for session, each in zip(sessions, names, strict=True):
        if each != names[0]:
            raise ContidError(f"{session.path}: other axes than {sessions[0].path}; a dataset has one robot")
    episodes = [read_episode(session, names[0], step) for session in sessions]
    part = folder.with_name(f".{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    try:
        rows: list[dict[str, Any]] = []
        tables: list[dict[str, Any]] = []
        start = 0
        for number, episode in enumerate(episodes):
            columns = episode.values | _own_columns(episode.frames, number, start, fps)
            at = {"chunk_index": number // _CHUNK, "file_index": number % _CHUNK}
            path = part / _DATA.format(**at)
            path.parent.mkdir(parents=True, exist_ok=True)
            parquet.write_table(pa.table({key: _column(values) for key, values in columns.items()}), path)
            rows.append(_episode_row(number, task, at, start, columns))
            tables.append(columns)
            start += episode.frames
        _write_meta(part, rows, tables, task, _info(sessions[0], names[0], rows, fps))
        part.rename(folder)
    except BaseException as error:
        shutil.rmtree(part, ignore_errors=True)
        if isinstance(error, OSError):
            raise ContidError(f"{folder}: cannot write it: {error.strerror}") from error
        raise
    return episodes


def _step(sessions: Sequence[Session], fps: int | None) -> tuple[int, int]:
    """Every how many-th tick is a frame, and frames per second."""
    rates = {session.rate_hz for session in sessions}
    if len(rates) != 1:
        raise ContidError(
            f"sessions at {', '.join(f'{rate:g}' for rate in sorted(rates))} Hz; allowed: one rate"
        )
    (rate_hz,) = rates
    fps = round(rate_hz) if fps is None else fps
    step = round(rate_hz / fps)
    if step < 1 or step * fps != rate_hz:
        allowed = [n for n in range(1, int(rate_hz) + 1) if (rate_hz / n).is_integer()]
        message = ", ".join(map(str, allowed)) or f"none for {rate_hz:g} Hz"
        raise ContidError(f"{fps} frames per second do not divide {rate_hz:g} Hz; allowed: {message}")
    return step, fps


def _own_columns(frames: int, number: int, start: int, fps: int) -> dict[str, Any]:
    count = np.arange(frames, dtype=np.int64)
    return {
        "timestamp": (count / fps).astype(np.float32),
        "frame_index": count,
        "episode_index": np.full(frames, number, dtype=np.int64),
        "index": count + start,
        "task_index": np.zeros(frames, dtype=np.int64),
    }


def _column(values: Any) -> Any:
    """An array of numbers, or of lists of a fixed length."""
    import pyarrow as pa

    if values.ndim == 1 or values.shape[1] == 1:
        return pa.array(values.reshape(-1))
    return pa.FixedSizeListArray.from_arrays(pa.array(values.reshape(-1)), values.shape[1])


def _statistics(values: Any) -> dict[str, list[float]]:
    rows = values.reshape(len(values), -1)
    exact = rows.astype(np.float64)
    found = {
        "min": rows.min(axis=0),
        "max": rows.max(axis=0),
        "mean": exact.mean(axis=0),
        "std": exact.std(axis=0),
        "count": np.array([len(rows)]),
    } | {name: np.quantile(exact, share, axis=0) for name, share in _QUANTILES.items()}
    return {name: each.tolist() for name, each in found.items()}


def _episode_row(
    number: int, task: str, at: dict[str, int], start: int, columns: dict[str, Any]
) -> dict[str, Any]:
    """The row of an episode in the table of episodes; ``at`` are the numbers of its folder and file."""
    length = len(columns["index"])
    statistics = {
        f"stats/{key}/{name}": value
        for key, values in columns.items()
        for name, value in _statistics(values).items()
    }
    return {
        "episode_index": number,
        "tasks": [task],
        "length": length,
        "data/chunk_index": at["chunk_index"],
        "data/file_index": at["file_index"],
        "dataset_from_index": start,
        "dataset_to_index": start + length,
        **statistics,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }


def _info(
    session: Session, names: dict[str, list[str]], rows: Sequence[dict[str, Any]], fps: int
) -> dict[str, Any]:
    """``meta/info.json``."""
    features: dict[str, Any] = {
        key: {"dtype": "float32", "shape": [len(each)], "names": each} for key, each in names.items()
    }
    features["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
    features |= {key: {"dtype": "int64", "shape": [1], "names": None} for key in _OWN}
    return {
        "codebase_version": _VERSION,
        "robot_type": session.robot_file().file.name,
        "total_episodes": len(rows),
        "total_frames": sum(row["length"] for row in rows),
        "total_tasks": 1,
        "chunks_size": _CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": f"0:{len(rows)}"},
        "data_path": _DATA,
        "video_path": None,
        "features": features,
    }


def _write_meta(
    folder: Path, rows: Sequence[dict[str, Any]], tables: Sequence[dict[str, Any]], task: str, info: Any
) -> None:
    """What LeRobot reads first: episodes, tasks, statistics and the description of the dataset."""
    import pandas as pd
    import pyarrow as pa
    from pyarrow import parquet

    meta = folder / "meta"
    episodes = meta / "episodes" / "chunk-000"
    episodes.mkdir(parents=True)
    parquet.write_table(pa.Table.from_pylist(list(rows)), episodes / "file-000.parquet")
    # LeRobot finds a task by the index of the table.
    pd.DataFrame({"task_index": [0]}, index=[task]).to_parquet(meta / "tasks.parquet")
    statistics = {key: _statistics(np.concatenate([columns[key] for columns in tables])) for key in tables[0]}
    (meta / "stats.json").write_text(json.dumps(statistics, indent=4), encoding="utf-8")
    (meta / "info.json").write_text(json.dumps(info, indent=4), encoding="utf-8")
