"""Writing a file completely or not at all."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, Final

from contid.errors import ContidError

#: Errors of file systems that cannot create a file without a name (O_TMPFILE).
_NO_NAMELESS: Final = (errno.EOPNOTSUPP, errno.EISDIR, errno.ENOENT, errno.EINVAL)


@contextmanager
def replacing(path: Path, mode: int | None = None) -> Iterator[BinaryIO]:
    """A new file that replaces ``path`` in one step when it is complete; devices are written directly.

    The new file has no name until then, so that nothing is left when this process is killed.

    Args:
        path: path of the file.
        mode: mode of the new file; None for that of an existing one, else the usual one.

    Raises:
        ContidError: the file cannot be written; an existing one is unchanged.
    """
    part: Path | None = None
    try:
        if path.exists() and not path.is_file():
            with path.open("wb") as file:
                yield file
            return
        target = _behind_links(path)
        part = target.with_name(f".{target.name}.{os.getpid()}.tmp")
        mode = _usual_mode(target) if mode is None else mode
        with _nameless(target.parent, part) as file:
            yield file
            file.flush()
            os.fchmod(file.fileno(), mode)
            os.fsync(file.fileno())
            _name(file.fileno(), part)
        part.replace(target)
        sync_folder(target.parent)
    except BaseException as error:
        if part is not None:
            # What prevented the file may prevent this too, as a folder that is none.
            with suppress(OSError):
                part.unlink()
        if isinstance(error, OSError):
            raise ContidError(f"{path}: cannot write it: {error.strerror or error}") from error
        raise


def _behind_links(path: Path) -> Path:
    """The path without symbolic links.

    Raises:
        OSError: the links form a circle.
    """
    target = Path(os.path.realpath(path))
    if target.is_symlink():
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
    return target


def _usual_mode(target: Path) -> int:
    with suppress(OSError):
        return stat.S_IMODE(target.stat().st_mode)
    return new_file_mode()


def new_file_mode() -> int:
    """The mode of new files of this process: 0o666 without its umask."""
    with suppress(OSError), Path("/proc/self/status").open("rb") as status:
        for line in status:
            if line.startswith(b"Umask:"):
                return 0o666 & ~int(line.split()[1], 8)
    # Files that other threads create at this moment get every right; hence only without /proc.
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def _nameless(folder: Path, part: Path) -> BinaryIO:
    """A file without a name, or ``part`` where the file system has no such files."""
    try:
        return os.fdopen(os.open(folder, os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o600), "w+b")
    except OSError as error:
        if error.errno not in _NO_NAMELESS:
            raise
    return part.open("w+b")


def _name(descriptor: int, part: Path) -> None:
    """Give a file without a name its name."""
    if os.fstat(descriptor).st_nlink:
        return
    # With a folder's descriptor Python calls linkat, which follows the link in /proc.
    folder = os.open(part.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        part.unlink(missing_ok=True)
        os.link(
            f"/proc/self/fd/{descriptor}",
            part.name,
            src_dir_fd=folder,
            dst_dir_fd=folder,
            follow_symlinks=True,
        )
    finally:
        os.close(folder)


def sync_folder(folder: Path) -> None:
    """Bring the names of a folder to the disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
