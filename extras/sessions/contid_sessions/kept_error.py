"""A file for a library that loses the errors of its writes, such as a full disk."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from typing import Any, BinaryIO


class KeptError(io.RawIOBase):
    """A file that keeps its first error, and from then on takes what comes and drops it.

    The library of Foxglove prints the error of a write and another one for every further message, and raises
    one without the cause at the end. h5py raises it, and prints others while it closes.

    Attributes:
        error: the first one; None while there is none.
    """

    def __init__(self, file: BinaryIO) -> None:
        super().__init__()
        self.error: OSError | None = None
        self._file = file
        self._at = self._end = file.tell()

    def write(self, data: Any) -> int:
        """Write, or drop after an error."""
        self._do(lambda: self._file.write(data))
        self._at += len(data)
        self._end = max(self._end, self._at)
        return len(data)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move, after an error in what the file would have been; returns the position."""
        begin = {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._end}[whence]
        self._at = begin + offset
        self._do(lambda: self._file.seek(self._at))  # the buffer is written first
        return self._at

    def readinto(self, buffer: Any) -> int:
        """Read what was written; after an error the buffer stays as it is."""
        found: list[bytes] = []
        self._do(lambda: found.append(self._file.read(len(buffer))))
        for data in found:
            buffer[: len(data)] = data
            self._at += len(data)
        return len(found[0]) if found else len(buffer)

    def truncate(self, size: int | None = None) -> int:
        """Set the length, unless there was an error."""
        self._end = self._at if size is None else size
        self._do(lambda: self._file.truncate(self._end))
        return self._end

    def flush(self) -> None:
        """Write the buffer, unless there was an error."""
        self._do(self._file.flush)

    def _do(self, step: Callable[[], object]) -> None:
        if self.error is None and not self._file.closed:
            try:
                step()
            except OSError as error:
                self.error = error
