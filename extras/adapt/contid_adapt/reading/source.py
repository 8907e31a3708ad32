"""The bytes of a file: which format they are, and their text."""

from __future__ import annotations

import gzip
import io
import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from contid.errors import BadInputError, ContidError, Located

#: A million rows of twenty columns.
MAX_BYTES: Final = 512 * 2**20
#: First bytes of formats that are no text: name, and "" for one that `contid_adapt.reading.binary` reads.
_FORMATS: Final = (
    (b"PAR1", "parquet", ""),
    (b"\x93NUMPY", "npy", ""),
    (b"PK\x03\x04", "zip", ""),
    (b"MATLAB 5.0", "mat", ""),
    (b"MATLAB 7.3", "hdf5", ""),  # HDF5 behind a head of 512 bytes
    (b"\x89HDF\r\n\x1a\n", "hdf5", ""),
    (b"\x89MCAP0\r\n", "mcap", "an MCAP recording: `contid session export` or `mcap convert` makes a CSV"),
    (b"#ROSBAG", "rosbag", "a ROS 1 bag: `rostopic echo -b FILE -p TOPIC > out.csv` makes a CSV"),
    (b"SQLite format 3", "sqlite", "an SQLite file (ROS 2 bag?): export a topic as CSV"),
    (b"%PDF", "pdf", "a PDF: export the table as CSV"),
    (b"\xd0\xcf\x11\xe0", "xls", "an old Excel file: save it as CSV"),
    (b"\x1f\x9d", "compress", "compressed with an unknown program: unpack it first"),
    (b"BZh", "bzip2", "compressed: unpack it with bunzip2"),
    (b"\xfd7zXZ", "xz", "compressed: unpack it with unxz"),
)


#: A quote that begins a cell and is not closed, and how many lines such a cell may go over.
_OPENS: Final = re.compile(r'(^|[,;\t|])\s*"[^"]*$')
_MOST_LINES: Final = 3


@dataclass(frozen=True, slots=True)
class Source:
    """A file read.

    Attributes:
        name: for messages.
        kind: "text", or the format of the bytes.
        data: the bytes, unpacked.
        text: for kind "text".
        note: what is worth saying about the encoding, "" for nothing.
    """

    name: str
    kind: str
    data: bytes
    text: str = ""
    note: str = ""


def read_source(path: str | Path) -> Source:
    """Read a file and find out what it is.

    Raises:
        ContidError: it cannot be read, is empty, too large, or of a format that cannot be read.
    """
    name = str(path)
    try:
        with Path(path).open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise ContidError(f"{name}: {error.strerror}") from error
    if data[:2] == b"\x1f\x8b":
        try:
            # Not the path again: a pipe gives its bytes once.
            with gzip.open(io.BytesIO(data)) as stream:
                data = stream.read(MAX_BYTES + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise _refused(name, f"compressed, but damaged: {error}") from error
    if len(data) > MAX_BYTES:
        raise _refused(name, f"more than {MAX_BYTES >> 20} MB; split the file")
    if not data.strip(b"\0 \t\r\n"):
        raise _refused(name, "the file is empty")
    for begin, kind, remedy in _FORMATS:
        if data.startswith(begin):
            if remedy:
                raise _refused(name, remedy)
            return Source(name, kind, data)
    text, note = _decoded(data)
    if text.count("\0") > 2:
        raise _refused(name, "neither text nor a format that is known; export the table as CSV")
    return Source(name, "text", data, text, note)


def lines_of(text: str) -> list[str]:
    r"""The lines of a text: ends are LF, CR LF, CR CR LF, or CR alone where there is nothing else."""
    if "\r" in text:
        text = text.replace("\r\r\n", "\n").replace("\r\n", "\n")
        if "\n" not in text:
            text = text.replace("\r", "\n")
    lines = text.split("\n")
    if lines[0].startswith("|") and sum(line.startswith("|") for line in lines) * 2 > len(lines):
        # A table of Markdown or of a database: blanks in place of the outer bars keep positions.
        lines = [
            "" if not line.strip("|-+: ") else " " + line[1:].rstrip().removesuffix("|") for line in lines
        ]
    if '"' in text:
        _join_quoted(lines)
    while len(lines) > 1 and not lines[-1].strip(" \t,;|\r\x1a\0"):
        lines.pop()
    return lines


def _join_quoted(lines: list[str]) -> None:
    """Put a quoted cell that goes over the ends of lines into one line; the others stay, empty."""
    begin = -1
    for index, line in enumerate(lines):
        if begin < 0:
            begin = index if line.count('"') % 2 and _OPENS.search(line) else -1
        elif index - begin > _MOST_LINES:
            begin = -1
        elif line.count('"') % 2:
            lines[begin] = " ".join(lines[begin : index + 1])
            lines[begin + 1 : index + 1] = [""] * (index - begin)
            begin = -1


def _decoded(data: bytes) -> tuple[str, str]:
    marks = ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"), (b"\xef\xbb\xbf", "utf-8-sig"))
    for begin, encoding in marks:
        if data.startswith(begin):
            return data.decode(encoding, "replace"), f"encoding {encoding}"
    head = data[:2000]
    if head.count(0) > len(head) // 3:
        little = head[1::2].count(0) > head[::2].count(0)
        encoding = "utf-16-le" if little else "utf-16-be"
        return data.decode(encoding, "replace"), f"encoding {encoding}"
    try:
        return data.decode("utf-8"), ""
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        return data.decode("cp1252", "replace"), f"not UTF-8 on line {line}: read as Windows-1252"


def _refused(name: str, message: str) -> BadInputError:
    return BadInputError([Located(name, 1, 1, message)])
