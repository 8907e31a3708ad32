"""The bytes of a file: which format they are, and their text."""

from __future__ import annotations

import gzip
import io
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from contid.errors import BadInputError, ContidError, Located

#: A million rows of twenty columns.
MAX_BYTES: Final = 512 * 2**20
_PICKLE: Final = (
    "a pickle of Python is a program and is not run here: save the table with to_csv or numpy.save"
)
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
    (b"ARROW1", "arrow", ""),
    (b"TDSm", "tdms", "a TDMS file of LabVIEW: export it as CSV or LVM"),
    (b"\x02P", "c3d", "a C3D file: export it as TRC or CSV"),
    (b"\x80\x03", "pickle", _PICKLE),
    (b"\x80\x04", "pickle", _PICKLE),
    (b"\x80\x05", "pickle", _PICKLE),
    (b"\x1f\x9d", "compress", "compressed with an unknown program: unpack it first"),
    (b"BZh", "bzip2", "compressed: unpack it with bunzip2"),
    (b"\xfd7zXZ", "xz", "compressed: unpack it with unxz"),
)


@dataclass(frozen=True, slots=True)
class Source:
    """A file read.

    Attributes:
        name: for messages.
        kind: "text", or the format of the bytes.
        data: the bytes, unpacked; of a text in UTF-8 without a mark.
        note: what is worth saying about the encoding, "" for nothing.
    """

    name: str
    kind: str
    data: bytes
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
    if text.count(b"\0") > 2:
        raise _refused(name, "neither text nor a format that is known; export the table as CSV")
    return Source(name, "text", text, note)


def _decoded(data: bytes) -> tuple[bytes, str]:
    """A text in UTF-8, and what is worth saying about the encoding that it had."""
    if data.startswith(b"\xef\xbb\xbf"):
        text, note = _decoded(data[3:])
        return text, note or "encoding utf-8-sig"
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", "replace").encode(), "encoding utf-16"
    head = data[:2000]
    if head.count(0) > len(head) // 3:
        little = head[1::2].count(0) > head[::2].count(0)
        encoding = "utf-16-le" if little else "utf-16-be"
        return data.decode(encoding, "replace").encode(), f"encoding {encoding}"
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        return data.decode("cp1252", "replace").encode(), f"not UTF-8 on line {line}: read as Windows-1252"
    return data, ""


def _refused(name: str, message: str) -> BadInputError:
    return BadInputError([Located(name, 1, 1, message)])
