"""Files that contid installs on a machine: udev rules, real-time priority, and the unit of the service.

They are in ``contid/host`` when installed (see CMakeLists.txt), in ``host`` of a checkout.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from contid.control.process.realtime import PRIORITY
from contid.errors import ContidError

UNIT: Final = "contid@.service"
RULES: Final = "99-contid.rules"
LIMITS: Final = "contid.conf"
UNIT_FOLDERS: Final = ("/etc/systemd/system", "/usr/local/lib/systemd/system", "/usr/lib/systemd/system")
RULES_FOLDERS: Final = ("/etc/udev/rules.d", "/usr/local/lib/udev/rules.d", "/usr/lib/udev/rules.d")
LIMITS_FOLDER: Final = "/etc/security/limits.d"


@dataclass(frozen=True)
class HostFile:
    """One file of the machine.

    Attributes:
        purpose: what it is for, the end of a question.
        path: where it goes.
        text: content of the file.
        then: commands that make the machine read it.
        after: what a person does next; "" for nothing.
    """

    purpose: str
    path: Path
    text: str
    then: tuple[tuple[str, ...], ...] = ()
    after: str = ""

    def install(self) -> None:
        """Write the file in one step and run the commands; what was there is kept as ``FILE.before``.

        Raises:
            ContidError: it cannot be written, or a command failed.
        """
        part = self.path.with_name(f".{self.path.name}.part")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            part.write_text(self.text, encoding="utf-8")
            part.chmod(0o644)
            if self.path.exists():
                shutil.copy2(self.path, f"{self.path}.before")
            part.replace(self.path)
        except OSError as error:
            with suppress(OSError):
                part.unlink()
            raise ContidError(f"{self.path}: cannot write it: {error.strerror}") from error
        for command in self.then:
            try:
                done = subprocess.run(command, capture_output=True, text=True, check=False)
            except OSError as error:
                raise ContidError(f"{self.path} is written; {' '.join(command)}: {error.strerror}") from error
            if done.returncode != 0:
                message = (done.stderr or done.stdout).strip() or f"exit code {done.returncode}"
                raise ContidError(f"{self.path} is written; {' '.join(command)}: {message}")


def shipped_text(name: str) -> str:
    """The text of a shipped file, by its name."""
    package = Path(__file__).resolve().parents[2]
    for folder in (package / "host", package.parent / "host"):
        if (folder / name).is_file():
            return (folder / name).read_text(encoding="utf-8")
    raise ContidError(f"{name} is not part of this installation")


def installed(root: Path, folders: Sequence[str], name: str) -> Path | None:
    """The first of several folders that has a file, with it."""
    for each in folders:
        path = root / each.lstrip("/") / name
        if path.is_file():
            return path
    return None


def missing_files(root: Path = Path("/"), service: bool = False) -> list[HostFile]:
    """The files that are absent, or have another text than those of this version.

    Args:
        root: root of the folders.
        service: also the unit, for robots that run without a logged-in user.
    """
    files = [
        HostFile(
            "access to serial ports without root, and 1 ms latency of FTDI adapters",
            _place(root, RULES_FOLDERS, RULES),
            shipped_text(RULES),
            (("udevadm", "control", "--reload"), ("udevadm", "trigger")),
            "plug the adapters in again",
        ),
        HostFile(
            f"real-time priority {PRIORITY} for members of group dialout",
            root / LIMITS_FOLDER.lstrip("/") / LIMITS,
            f"# contid: ticks on time under load.\n@dialout - rtprio {PRIORITY}\n",
            (),
            "log in again",
        ),
    ]
    if service:
        files.append(
            HostFile(
                "robots that run without a logged-in user",
                _place(root, UNIT_FOLDERS, UNIT),
                shipped_text(UNIT),
                (("systemctl", "daemon-reload"),),
                "user, group and robot file: docs/service.md",
            )
        )
    return [file for file in files if _text(file.path) != file.text]


def _place(root: Path, folders: Sequence[str], name: str) -> Path:
    return installed(root, folders, name) or root / folders[0].lstrip("/") / name


def _text(path: Path) -> str | None:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None


def may_install(root: Path = Path("/")) -> bool:
    """Whether this process may write below ``/etc``."""
    return os.access(root / "etc", os.W_OK)
