"""Arguments of `contid move`."""

from __future__ import annotations

import pytest

from contid.errors import ContidError
from contid.remote.client.move_arguments import columns_and_rows, point


def test_text_becomes_points_and_rows() -> None:
    assert point(["left", "x_mm=40", "y_mm=75"]) == {"left.x_mm": 40.0, "left.y_mm": 75.0}
    assert point(["x_mm=4e1"]) == {"x_mm": 40.0}
    for wrong in (["x_mm=far"], ["left"], ["x_mm=1", "y_mm"]):
        with pytest.raises(ContidError):
            point(wrong)
    columns, rows = columns_and_rows(["# a circle\n", "t_s,x_mm\n", "0,1\n", "\n", "1,2\n"])
    assert (columns, list(rows)) == (["t_s", "x_mm"], [[0.0, 1.0], [1.0, 2.0]])
    columns, rows = columns_and_rows(["x_mm\n", "one\n"])
    with pytest.raises(ContidError, match="trajectory:2"):
        list(rows)
