"""The sketch's sources, and the same core built for this computer (cached by the sources' content)."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from contid.errors import DeviceError

#: What the sketch itself must compile with: the Arduino SAM core uses gcc 4.8.
SKETCH_STANDARD: Final = "-std=gnu++11"
#: What another compiler than ours warns of shall not keep anybody from the emulator.
_HOST_FLAGS: Final = ("-std=gnu++17", "-O1", "-pthread")
#: Of every build in the tests.
WARNINGS: Final = ("-Wall", "-Wextra", "-Werror", "-Wconversion")
_ELSEWHERE: Final = "set XDG_CACHE_HOME to a folder you may write to"


def firmware_dir() -> Path:
    """The folder ``firmware``: of a checkout, of an installed contid, or ``$CONTID_FIRMWARE``.

    Raises:
        DeviceError: none of them is there.
    """
    given = os.environ.get("CONTID_FIRMWARE")
    candidates = [
        *([Path(given)] if given else []),
        Path(__file__).parent / "_firmware",
        Path(__file__).parents[3] / "firmware",
    ]
    for folder in candidates:
        if (folder / "contid_due" / "src" / "core" / "board.cpp").is_file():
            return folder
    raise DeviceError(
        "firmware", f"its sources are in none of {', '.join(map(str, candidates))}", "set CONTID_FIRMWARE"
    )


def core_sources() -> list[Path]:
    """The portable core: what runs on the board and here."""
    return sorted((firmware_dir() / "contid_due" / "src" / "core").glob("*.cpp"))


def cache_dir() -> Path:
    """Where built programs are kept.

    Raises:
        DeviceError: nowhere: this user has no home folder, as in some containers.
    """
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        cache = Path(base) if base else Path.home() / ".cache"
    except RuntimeError as error:
        raise DeviceError("due emulator", "no home folder to build it in", _ELSEWHERE) from error
    return cache / "contid" / "firmware"


def build_host(extra_flags: Sequence[str] = (), main: str = "main.cpp") -> Path:
    """The emulator of this computer, built when its sources changed.

    Args:
        extra_flags: more compiler flags, for example sanitizers.
        main: the file in ``firmware/host`` that has ``main``.

    Raises:
        DeviceError: there is no g++, it refuses the sources, or there is no place for the program.
    """
    host = firmware_dir() / "host"
    sources = [*core_sources(), host / "machine.cpp", host / "plant.cpp", host / main]
    headers = [*sorted(sources[0].parent.glob("*.h")), *sorted(host.glob("*.h"))]
    flags = [*_HOST_FLAGS, *extra_flags]
    digest = hashlib.sha256(" ".join(flags).encode())
    for path in (*sources, *headers):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    program = cache_dir() / f"{Path(main).stem}-{digest.hexdigest()[:16]}"
    if program.is_file():
        return program
    compiler = shutil.which("g++")
    if compiler is None:
        raise DeviceError(
            "due emulator",
            "it is the firmware built for this computer, and there is no g++",
            "apt install g++",
        )
    try:
        program.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        why = f"cannot keep what is built in {program.parent}: {error.strerror or error}"
        raise DeviceError("due emulator", why, _ELSEWHERE) from error
    fresh = program.with_name(f"{program.name}.{os.getpid()}")
    done = subprocess.run(
        [compiler, *flags, "-o", str(fresh), *map(str, sources)], capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise DeviceError("due emulator", f"g++ refuses the firmware:\n{done.stderr.strip()}")
    # In one step, so that two builders at once both end with a whole program.
    fresh.replace(program)
    return program
