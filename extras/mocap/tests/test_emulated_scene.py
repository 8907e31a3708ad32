"""Poses on stdin of an emulated server: a wrong line is refused with what is expected, and moves nothing."""

from __future__ import annotations

import pytest

from contid.errors import ContidError
from contid_mocap.emulate.scene import EmulatedScene

HERE = (0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize(
    "line",
    ["", "{", "[1, 2]", "7", '{"tip": 1}', '{"tip": [0, 0, 0]}', '{"tip": [0, 0, 0, 0, 0, 0, "x"]}',
     '{"base": [0, 0, 0, 0, 0, 0, 1], "tip": [null, 0, 0, 0, 0, 0, 1]}', "[" * 100_000,
     '{"tip": "1234567"}', '{"tip": [0, 0, 0, 0, 0, 0, "1"]}', '{"tip": [0, 0, 0, 0, 0, 0, true]}',
     '{"tip": {"0": 0, "1": 0, "2": 0, "3": 0, "4": 0, "5": 0, "6": 1}}',
     '{"tip": [NaN, 0, 0, 0, 0, 0, 1]}', '{"tip": [1e300, 0, 0, 0, 0, 0, 1]}',
     f'{{"tip": [1{"0" * 400}, 0, 0, 0, 0, 0, 1]}}'],
)  # fmt: skip
def test_a_wrong_line_is_refused(line: str) -> None:
    scene = EmulatedScene({"tip": HERE})
    with pytest.raises(ContidError, match=r"^stdin: .{0,82}: a line .* is expected$"):
        scene.move(line)
    assert scene.bodies == {"tip": HERE}
    assert scene.moving


def test_a_line_moves_and_hides_bodies() -> None:
    scene = EmulatedScene({"tip": HERE, "base": HERE})
    scene.move('{"tip": [1, 2, 3, 0, 0, 0, 1], "base": null}')
    assert scene.at(5.0) == {"tip": (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0), "base": None}
