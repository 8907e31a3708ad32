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

import contid
from contid.control.process.realtime import PRIORITY
from contid.errors import ContidError

UNIT: Final = "contid@.service"
RULES: Final = "99-contid.rules"
LIMITS: Final = "contid.conf"
UNIT_FOLDERS: Final = ("/etc/systemd/system", "/usr/local/lib/systemd/system", "/usr/lib/systemd/system")
RULES_FOLDERS: Final = ("/etc/udev/rules.d", "/usr/local/lib/udev/rules.d", "/usr/lib/udev/rules.d")
LIMITS_FOLDER: Final = "/etc/security/limits.d"
#: How long a command that makes the machine read a file may take [s].
COMMAND_S: Final = 30.0


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
        """Write the file in one step and run the commands.

        What was there is kept as ``FILE.before``, or ``FILE.before2`` and so on.

        Raises:
            ContidError: it cannot be written, is masked, or commands failed, which are named.
        """
        if self.path.is_symlink() and self.path.samefile(os.devnull):
            raise ContidError(f"{self.path} is masked; `systemctl unmask {self.path.name}` first")
        if self.path.exists() and not self.path.is_file():
            raise ContidError(f"{self.path}: cannot write it: it is no file")
        path = self.path.resolve()
        part = path.with_name(f".{path.name}.part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            part.write_text(self.text, encoding="utf-8")
            part.chmod(0o644)
            if path.exists():
                shutil.copy2(path, _unused(f"{path}.before"))
            part.replace(path)
        except OSError as error:
            with suppress(OSError):
                part.unlink()
            raise ContidError(f"{self.path}: cannot write it: {error.strerror or error}") from error
        if failed := {command: why for command in self.then if (why := _failure(command))}:
            todo = " && ".join(" ".join(command) for command in failed)
            why = "; ".join(failed.values())
            raise ContidError(f"{self.path} is written and not yet in force: {why}; as root: {todo}")


def _unused(name: str) -> Path:
    numbers = ("", *range(2, 1000))
    return next(path for number in numbers if not (path := Path(f"{name}{number}")).exists())


def _failure(command: tuple[str, ...]) -> str:
    """Run a command; why it failed, "" if it did not."""
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", check=False, timeout=COMMAND_S
        )
    except OSError as error:
        return f"{' '.join(command)}: {error.strerror}"
    except subprocess.TimeoutExpired:
        return f"{' '.join(command)}: no end within {COMMAND_S:g} s"
    message = (done.stderr or done.stdout).strip() or f"exit code {done.returncode}"
    return f"{' '.join(command)}: {message}" if done.returncode else ""


def shipped_text(name: str) -> str:
    """The text of a shipped file, by its name."""
    package = Path(contid.__file__).resolve().parent
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
