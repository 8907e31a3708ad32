"""Builds the head of a session: robot file, versions, host, options, clock, input.

It is plain text and bytes, so the recorder's process needs neither models nor drivers, and a reader needs
only the file.
"""

from __future__ import annotations

import hashlib
import io
import json
import platform
import socket
import sys
import time
import zipfile
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from pkgutil import iter_modules
from typing import Any, Final

import numpy as np

from contid import __version__, kernels
from contid.control.engine.wiring import record_layout
from contid.control.process.pipe import RunSetup
from contid.control.tick.config import MOTION_RULES
from contid.errors import ContidError
from contid.hal import DeviceKind, load_driver
from contid.robot_file.load import LoadedFile
from contid.session.format.channels import REVISION
from contid.session.format.header import NPZ, Header
from contid.trajectory.columns import read_layout
from contid.trajectory.rows import MAX_ROWS
from contid.trajectory.timed import Interpolation, Trajectory

#: Increased when older readers would misread a file.
FORMAT: Final = "1"
TRAJECTORY: Final = "trajectory"
#: Option of a session whose first tick is not that of the run.
DURING_RUN: Final = "during_run"
_ROWS: Final = "rows.npy"
#: More bytes than the head of an array in NumPy's file format.
_NPY_HEAD: Final = 10_000


def describe(setup: RunSetup, options: Mapping[str, str], virtual: bool, host: str | None = None) -> Header:
    """The head of a session of a run.

    Args:
        setup: setup of the run.
        options: further options, for the reader.
        virtual: the ticks count virtual time from 0.
        host: instead of this machine's name.
    """
    loaded = setup.loaded
    layout = record_layout(loaded, setup.rate_hz)
    units = device_units(loaded)
    wall_ns, monotonic_s = time.time_ns(), 0.0 if virtual else time.monotonic()
    metadata: dict[str, dict[str, str]] = {
        "contid": {
            "format": FORMAT,
            "revision": str(REVISION),
            "motion_rules": str(MOTION_RULES),
            "contid": __version__,
            "python": platform.python_version(),
            "numpy": version("numpy"),
            "kernels": ", ".join(compiled_kernels()) or "none (NumPy)",
            "host": host or socket.gethostname(),
            "kernel": f"{platform.system()} {platform.release()}",
            "machine": platform.machine(),
            "created": datetime.fromtimestamp(wall_ns / 1e9, UTC).isoformat(timespec="milliseconds"),
        },
        "robot_file": {
            "name": _text(str(loaded.path)),
            "text": loaded.text,
            "sha256": hashlib.sha256(loaded.text.encode()).hexdigest(),
        },
        "options": {
            "rate_hz": repr(setup.rate_hz),
            "on_end": setup.on_end.value,
            "attended": json.dumps(setup.attended),
            "armed": json.dumps(setup.armed),
            "virtual": json.dumps(virtual),
            **{name: _text(value) for name, value in options.items()},
        },
        "clock": {
            "wall_ns": str(wall_ns),
            "monotonic_s": repr(monotonic_s),
            "log_time": "wall_ns + (deadline_s - monotonic_s) * 1e9",
        },
        "layout": {"record": layout.to_json(), "device_units": json.dumps(units)},
    }
    attachments: tuple[tuple[str, str, bytes], ...] = ()
    if setup.trajectory is not None:
        attachments = ((f"{TRAJECTORY}.npz", NPZ, encode_trajectory(setup.trajectory)),)
        metadata[TRAJECTORY] = trajectory_metadata(setup.trajectory)
    return Header(layout, units, metadata, attachments, wall_ns, monotonic_s)


def _text(name: str) -> str:
    """A file's name as text: bytes that are no UTF-8, which paths may hold and MCAP may not, as escapes."""
    return name.encode("utf-8", "backslashreplace").decode()


def compiled_kernels() -> list[str]:
    """Kernels of this installation."""
    names = {
        each.name.removeprefix("_").removesuffix("_avx2")
        for each in iter_modules(kernels.__path__)
        if each.name[0] == "_"
    }
    return sorted(names)


def device_units(loaded: LoadedFile) -> dict[str, str]:
    """``rad`` or ``pa`` of every axis: the unit of its device."""
    units = {}
    for bus in loaded.buses.values():
        driver = load_driver(bus.driver)
        for axis, options in bus.axes:
            units[axis] = "pa" if driver.kind(options) is DeviceKind.REGULATOR else "rad"
    return units


def trajectory_metadata(trajectory: Trajectory) -> dict[str, str]:
    """The metadata of an attached trajectory."""
    return {
        "columns": json.dumps(list(trajectory.columns)),
        "interpolation": trajectory.interpolation.value,
        "rows": str(len(trajectory)),
        "units": "SI in the order of the columns",
        "sha256": hashlib.sha256(trajectory.rows.tobytes()).hexdigest(),
    }


def encode_trajectory(trajectory: Trajectory, at_once: bool = False) -> bytes:
    """The rows as an ``.npz``: SI float64, shape (rows, columns); ``at_once`` does not compress them."""
    out = io.BytesIO()
    kind = zipfile.ZIP_STORED if at_once else zipfile.ZIP_DEFLATED
    with (
        zipfile.ZipFile(out, "w", kind, compresslevel=None if at_once else 1) as archive,
        archive.open(_ROWS, "w", force_zip64=True) as file,
    ):
        np.save(file, trajectory.rows, allow_pickle=False)
    return out.getvalue()


def decode_trajectory(data: bytes, about: Mapping[str, str], loaded: LoadedFile) -> Trajectory:
    """The recorded trajectory, bit for bit.

    Raises:
        BadInputError: the robots do not have its columns.
        ContidError: the attachment is damaged.
    """
    try:
        names = [str(name) for name in json.loads(about["columns"])]
        interpolation = Interpolation(about["interpolation"])
    except (ValueError, TypeError, RecursionError) as error:
        raise ContidError(f"the recorded trajectory is damaged: {error}") from error
    layout = read_layout([(name, 1) for name in names], "the recorded trajectory", 1, loaded.driven)
    try:
        rows = _rows(data, len(names))
    except Exception as error:  # zipfile and NumPy have a dozen kinds of errors for damaged data
        raise ContidError(f"the recorded trajectory is damaged: {error}") from error
    if hashlib.sha256(rows.tobytes()).hexdigest() != about["sha256"]:
        raise ContidError("the recorded trajectory is damaged: its checksum does not match its metadata")
    rows.setflags(write=False)
    return Trajectory(layout, rows, range(1, len(rows) + 1), interpolation)


def _rows(data: bytes, columns: int) -> Any:
    """The array of an attachment, shape (rows, columns); its declared size is checked before it is read.

    Raises:
        Exception: it is damaged, or declares more than `MAX_ROWS` rows.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        size = archive.getinfo(_ROWS).file_size
        if size > _NPY_HEAD + MAX_ROWS * columns * 8:
            raise ValueError(f"it declares {size} bytes; at most {MAX_ROWS} rows are allowed")
        plain = archive.read(_ROWS)
    head = io.BytesIO(plain)
    np.lib.format.read_magic(head)
    shape, _, kind = np.lib.format.read_array_header_1_0(head, _NPY_HEAD)
    fits = len(shape) == 2 and shape[0] > 0 and shape[1] == columns and kind == np.float64
    if not fits or len(plain) - head.tell() != shape[0] * columns * 8:
        raise ValueError(f"{shape} {kind} in {len(plain)} bytes are not {columns} columns of numbers")
    return np.load(io.BytesIO(plain), allow_pickle=False)


def versions() -> dict[str, str]:
    """Versions that a replay compares with the recorded ``contid`` metadata."""
    return {
        "contid": __version__,
        "python": f"{sys.version_info.major}.{sys.version_info.minor}.{sys.version_info.micro}",
        "numpy": version("numpy"),
        "kernels": ", ".join(compiled_kernels()) or "none (NumPy)",
        "machine": platform.machine(),
    }
