"""Sources of the sketch, and the emulator built from them for this computer (cached by content)."""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from contid.errors import DeviceError
from contid_drivers import due

#: Standard of the sketch: the Arduino SAM core uses gcc 4.8.
SKETCH_STANDARD: Final = "-std=gnu++11"
#: Without -Werror: a warning of an unknown compiler must not block the emulator.
_HOST_FLAGS: Final = ("-std=gnu++17", "-O1", "-pthread")
#: Warnings of every build in the tests.
WARNINGS: Final = ("-Wall", "-Wextra", "-Werror", "-Wconversion")
_CACHE_REMEDY: Final = "set XDG_CACHE_HOME to a folder you may write to"


def firmware_dir() -> Path:
    """The folder ``firmware``: ``$CONTID_FIRMWARE``, else that of an installed contid or of a checkout.

    Raises:
        DeviceError: it has no sources.
    """
    given = os.environ.get("CONTID_FIRMWARE")
    driver = Path(due.__file__).parent
    installed, checkout = driver / "_firmware", driver.parents[2] / "firmware"
    # Where the variable names a folder, other sources must not be built, or flashed, instead.
    candidates = [Path(given)] if given else [installed, checkout]
    for folder in candidates:
        if (folder / "contid_due" / "src" / "core" / "board.cpp").is_file():
            return folder
    wrong = " or ".join(map(str, candidates))
    remedy = "CONTID_FIRMWARE: a folder with contid_due/src/core"
    raise DeviceError("firmware", f"no sources in {wrong}", remedy)


def core_sources() -> list[Path]:
    """Sources of the portable core, which runs on the board and on a PC.

    Raises:
        DeviceError: as `firmware_dir`.
    """
    return sorted((firmware_dir() / "contid_due" / "src" / "core").rglob("*.cpp"))


def build_id() -> int:
    """Number of the sketch's sources: `contid firmware flash` builds it in, a board reports it.

    Never 0, which boards report whose sketch was built by hand.

    Raises:
        DeviceError: as `firmware_dir`.
    """
    sketch = firmware_dir() / "contid_due"
    digest = hashlib.sha256()
    for path in sorted(path for path in sketch.rglob("*") if path.suffix in (".h", ".cpp", ".ino")):
        digest.update(path.relative_to(sketch).as_posix().encode() + b"\0" + path.read_bytes())
    return int.from_bytes(digest.digest()[:4], "little") or 1


def build_note(reported: int) -> str:
    """What the build id that a board reports means for its sketch.

    Raises:
        DeviceError: as `firmware_dir`.
    """
    if reported == 0:
        return "built by hand"
    if reported == build_id():
        return "built from these sources"
    return "built from other sources: contid firmware flash"


def cache_dir() -> Path:
    """Folder of built programs.

    Raises:
        DeviceError: this user has no home folder, as in some containers.
    """
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        cache = Path(base) if base else Path.home() / ".cache"
    except RuntimeError as error:
        raise DeviceError("due emulator", "no home folder to build it in", _CACHE_REMEDY) from error
    return cache / "contid" / "firmware"


def build_host(extra_flags: Sequence[str] = (), main: str = "main.cpp") -> Path:
    """A host program, built anew when its sources changed.

    Args:
        extra_flags: more compiler flags, for example sanitizers.
        main: the file in ``firmware/host`` with ``main``.

    Raises:
        DeviceError: no g++, the build fails, or the cache cannot be written.
    """
    host = firmware_dir() / "host"
    sources = [*core_sources(), host / "machine.cpp", host / "plant.cpp", host / main]
    return build_once(Path(main).stem, ["g++", *_HOST_FLAGS, *extra_flags], sources, host.glob("*.h"))


def build_once(
    name: str, compiler: Sequence[str], sources: Sequence[Path], included: Iterable[Path], suffix: str = ""
) -> Path:
    """A program in the cache, built anew when its flags or its files changed.

    Args:
        name: name of the program.
        compiler: compiler with its flags.
        sources: sources to compile and link.
        included: further files that the program is made of, besides the headers of the core.
        suffix: suffix of the program.

    Raises:
        DeviceError: no compiler, the build fails, or the cache cannot be written.
    """
    headers = (firmware_dir() / "contid_due" / "src" / "core").rglob("*.h")
    digest = hashlib.sha256(" ".join(compiler).encode())
    for path in (*sources, *sorted(headers), *sorted(included)):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    program = cache_dir() / f"{name}-{digest.hexdigest()[:16]}{suffix}"
    if program.is_file():
        return program
    if shutil.which(compiler[0]) is None:
        raise DeviceError(
            "due emulator", f"it is built from the firmware, and {compiler[0]} is missing", "apt install g++"
        )
    try:
        program.parent.mkdir(parents=True, exist_ok=True)
        lock = program.with_name(f"{program.name}.lock").open("w")
    except OSError as error:
        why = f"cannot keep the program in {program.parent}: {error.strerror or error}"
        raise DeviceError("due emulator", why, _CACHE_REMEDY) from error
    with lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # of two builders at once one waits for the program of the other
        if program.is_file():
            return program
        fresh = program.with_name(f"{program.name}.{os.getpid()}")
        command = [*compiler, "-o", str(fresh), *map(str, sources)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise DeviceError("due emulator", f"the build of {name} fails:\n{done.stderr.strip()}")
        fresh.replace(program)
    return program
