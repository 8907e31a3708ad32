"""A file for a library that loses the errors of its writes, such as a full disk."""

from __future__ import annotations

import os
from typing import BinaryIO


class KeptError:
    """A file that keeps its first error, and from then on takes what comes and drops it.

    The library of Foxglove prints the error of a write and another one for every further message, and raises
    one without the cause at the end.

    Attributes:
        error: the first one; None while there is none.
    """

    def __init__(self, file: BinaryIO) -> None:
        self.error: OSError | None = None
        self._file = file
        self._at = self._end = file.tell()

    def write(self, data: bytes | bytearray) -> int:
        """Write, or drop after an error."""
        if self.error is None:
            try:
                self._file.write(data)
            except OSError as error:
                self.error = error
        self._at += len(data)
        self._end = max(self._end, self._at)
        return len(data)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move, after an error in what the file would have been; returns the position."""
        begin = {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._end}[whence]
        self._at = begin + offset
        if self.error is None:
            try:
                self._file.seek(self._at)
            except OSError as error:  # the buffer is written first
                self.error = error
        return self._at

    def flush(self) -> None:
        """Write the buffer, unless there was an error."""
        if self.error is None:
            try:
                self._file.flush()
            except OSError as error:
                self.error = error
