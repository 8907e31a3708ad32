"""A file for a library that loses the errors of its writes, such as a full disk."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import BinaryIO


class KeptError:
    """A file that keeps its first error, and from then on takes what comes and drops it.

    The library of Foxglove prints the error of a write and another one for every further message, and raises
    one without the cause at the end. h5py raises it, and prints others while it closes.

    Attributes:
        error: the first one; None while there is none.
    """

    def __init__(self, file: BinaryIO) -> None:
        self.error: OSError | None = None
        self._file = file
        self._at = self._end = file.tell()

    def write(self, data: bytes | bytearray | memoryview) -> int:
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

    def tell(self) -> int:
        """The position."""
        return self._at

    def read(self, size: int) -> bytes:
        """Read what was written; after an error zeros."""
        found: list[bytes] = []
        self._do(lambda: found.append(self._file.read(size)))
        data = b"".join(found) or bytes(size)
        self._at += len(data)
        return data

    def truncate(self, size: int) -> int:
        """Set the length, unless there was an error."""
        self._do(lambda: self._file.truncate(size))
        self._end = size
        return size

    def flush(self) -> None:
        """Write the buffer, unless there was an error."""
        self._do(self._file.flush)

    def _do(self, step: Callable[[], object]) -> None:
        if self.error is None:
            try:
                step()
            except OSError as error:
                self.error = error
