"""One error tree: what failed, where, what is allowed, what to do next.

Every error a user can cause or meet derives from `ContidError`; the command line turns it into one message
on stderr and the exit code of its class (see docs: 0 done, 1 comparison failed, 2 usage or a bad file,
3 a fault stopped the robot, 4 a device could not be opened, 130 interrupted).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


class ContidError(Exception):
    """Base of everything contid raises on purpose."""

    exit_code = 2


@dataclass(frozen=True, slots=True)
class Located:
    """One finding in a user's file: ``file:line:column: message`` (line and column count from 1)."""

    file: str
    line: int
    column: int
    message: str

    def __str__(self) -> str:
        """The finding the way compilers print it, so editors can jump to it."""
        return f"{self.file}:{self.line}:{self.column}: {self.message}"


class BadInputError(ContidError):
    """A user's file or stream is wrong; carries every finding, not only the first."""

    def __init__(self, findings: Sequence[Located]) -> None:
        self.findings = tuple(findings)
        super().__init__("\n".join(str(finding) for finding in self.findings))


class DeviceError(ContidError):
    """A device said no, or could not be reached; ``device`` names it the way the robot file does."""

    exit_code = 4

    def __init__(self, device: str, message: str, remedy: str = "") -> None:
        self.device = device
        self.message = message
        self.remedy = remedy
        super().__init__(f"{device}: {message}" + (f" ({remedy})" if remedy else ""))


class DeviceNotFoundError(DeviceError):
    """The port, id or channel is not there, or the handshake found something else."""


class DeviceLostError(DeviceError):
    """A device that was open is gone: unplugged, reset without being asked, or its port failed."""


class FaultError(ContidError):
    """A fault stopped the robot."""

    exit_code = 3


class ComparisonError(ContidError):
    """A comparison the user asked for failed (replay, golden values)."""

    exit_code = 1
