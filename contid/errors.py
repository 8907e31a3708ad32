"""The error tree of contid.

Every error that a user can cause or meet derives from `ContidError`; the command line prints its message on
stderr and exits with the exit code of its class (1 a lost recording, 2 usage or a bad file, 4 a device error
or a defect of a driver). A run that ends with a robot in FAULT is no error; its exit code is 3.
"""

from __future__ import annotations

import copyreg
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Any, Final

#: At most this many findings of one file are listed.
MAX_FINDINGS: Final = 100


class ContidError(Exception):
    """Base of all errors of contid."""

    exit_code = 2

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled without its constructor, whose arguments are not those of `Exception`."""
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]  # not in its stubs


@dataclass(frozen=True, slots=True)
class Located:
    """One finding in a user's file: ``file:line:column: message`` (line and column count from 1)."""

    file: str
    line: int
    column: int
    message: str

    def __str__(self) -> str:
        """The format of compilers, which editors can jump to."""
        return f"{self.file}:{self.line}:{self.column}: {self.message}"


def first_findings(findings: Iterable[Located]) -> list[Located]:
    """Findings in the order of the file, each once; a last one ends a list cut at `MAX_FINDINGS`."""
    order = sorted(dict.fromkeys(findings), key=lambda found: (found.line, found.column))
    if len(order) > MAX_FINDINGS:
        more = f"the first {MAX_FINDINGS} mistakes are listed; correct them, then check the file again"
        order[MAX_FINDINGS:] = [replace(order[MAX_FINDINGS], message=more)]
    return order


class BadInputError(ContidError):
    """A user's file or stream is wrong; holds every finding."""

    def __init__(self, findings: Sequence[Located]) -> None:
        self.findings = tuple(findings)
        super().__init__("\n".join(str(finding) for finding in self.findings))


class MissingPackageError(ContidError):
    """A package of `extras` is not installed; the message has what needs it, and the remedy."""


class SessionError(ContidError):
    """A file is not a session, or not one that this version can read."""


class RecordingStoppedError(ContidError):
    """A recording that had begun lacks its end: the disk is full or has failed."""

    exit_code = 1


class DriverDefectError(ContidError):
    """A driver raised an error that it does not document."""

    exit_code = 4


class DeviceError(ContidError):
    """A device refused, or could not be reached; ``device`` is its name in the robot file."""

    exit_code = 4

    def __init__(self, device: str, message: str, remedy: str = "") -> None:
        self.device = device
        self.message = message
        self.remedy = remedy
        super().__init__(f"{device}: {message}" + (f" ({remedy})" if remedy else ""))


class DeviceNotFoundError(DeviceError):
    """The port, id or channel does not exist, or the handshake found another device."""


class DeviceLostError(DeviceError):
    """An open device is gone: unplugged, reset unexpectedly, or its port failed."""


#: Package, as it is imported -> the extra of ``pip install 'contid[EXTRA]'`` that has it.
EXTRAS: Final = {
    "cryptography": "fleet",
    "cv2": "track",
    "foxglove": "data",
    "gymnasium": "learn",
    "h5py": "data",
    "matplotlib": "plots",
    "onnx": "learn",
    "onnxruntime": "learn",
    "pandas": "data",
    "pyarrow": "data",
    "rerun": "view",
    "rosbags": "ros",
    "scipy": "fit",
    "shapely": "plots",
    "starlette": "panel",
    "toppra": "retime",
    "uvicorn": "panel",
    "websockets": "panel",
    "zenoh": "fleet",
}


class MissingExtraError(ContidError, ImportError):
    """A package of an extra is not installed: ``to_pandas needs pandas: pip install 'contid[data]'``."""

    def __init__(self, what: str, package: str, extra: str) -> None:
        super().__init__(f"{what} needs {package}: pip install 'contid[{extra}]'")


def require_extra(what: str, *packages: str) -> None:
    """Refuse to go on without packages of an extra, named as they are imported.

    Raises:
        MissingExtraError: with the remedy.
    """
    missing = [package for package in packages if find_spec(package) is None]
    if missing:
        raise MissingExtraError(what, ", ".join(missing), EXTRAS[missing[0]])


def missing_extra(error: ImportError, what: str) -> ContidError | None:
    """The error to show when ``what`` failed to import a package of an extra; None for other imports."""
    package = (error.name or "").partition(".")[0]
    if not isinstance(error, ModuleNotFoundError) or package not in EXTRAS:
        return None
    return MissingExtraError(what, package, EXTRAS[package])
