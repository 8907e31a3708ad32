"""Bytes of files before their text: compressed ones, from pipes, and with a head before their format."""

from __future__ import annotations

import gzip
import os
import threading
from pathlib import Path

import numpy as np
import pytest

from contid.errors import BadInputError
from contid_adapt.reading.read import read_table


def test_a_compressed_table_through_a_pipe(tmp_path: Path) -> None:
    """As of ``contid adapt <(ssh host cat walk.csv.gz)``: a pipe gives its bytes once."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    feeding = threading.Thread(target=pipe.write_bytes, args=(gzip.compress(b"t,x\n0,1\n1,2\n"),))
    feeding.start()
    found = read_table(pipe)
    feeding.join()
    assert [each.name for each in found.columns] == ["t", "x"]


def test_a_damaged_compressed_table_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv.gz"
    packed = bytearray(gzip.compress(b"t,x\n" + b"".join(b"%d,%d\n" % (k, k * k % 97) for k in range(999))))
    for at in range(10, len(packed)):
        path.write_bytes(packed[:at] + b"\xff" * 40 + packed[at + 40 :])
        with pytest.raises(BadInputError, match=r"a.csv.gz:1:1: compressed, but damaged"):
            read_table(path)
        if at > 60:
            break


def test_a_file_of_matlab_7_3_is_hdf5_behind_a_head(tmp_path: Path) -> None:
    """As ``save -v7.3`` writes it; the head by "MAT-File Format", The MathWorks."""
    h5py = pytest.importorskip("h5py", reason="pip install 'contid[data]'")
    path = tmp_path / "walk.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"], file["x"] = np.array([[0.0, 0.1, 0.2]]), np.array([[4.0, 5.0, 6.0]])
    with path.open("r+b") as head:
        text = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan  1 00:00:00 2024"
        head.write(text.ljust(124) + b"\x00\x02IM")
    found = {each.name: list(each.values) for each in read_table(path).columns}
    assert found == {"t": [0.0, 0.1, 0.2], "x": [4.0, 5.0, 6.0]}
