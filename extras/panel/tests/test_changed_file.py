"""The page draws the robots that the daemon has: a file that was changed meanwhile is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from contid.errors import ContidError
from contid.remote.server.telemetry_view import TelemetryView
from contid.robot_file.load import load_named, load_robot_file, with_mock
from contid_panel.geometry import PanelGeometry


def described(path: Path) -> dict[str, object]:
    view = TelemetryView(with_mock(load_robot_file(path)), 200.0, lambda: None)
    return {**view.describe(), "rate_hz": 200.0}


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("length_mm: 42.0", "length_mm: 84.0", False),
        ("    rates:\n", "    # a remark\n    rates:\n", True),
    ],
)
def test_a_changed_body_is_refused_and_a_remark_is_not(
    tmp_path: Path, old: str, new: str, same: bool
) -> None:
    path, text = tmp_path / "arm.yaml", load_named("stiffflop1").text
    path.write_text(text)
    describe = described(path)
    PanelGeometry.of(describe)
    assert text.count(old) >= 1
    path.write_text(text.replace(old, new))
    if same:
        PanelGeometry.of(describe)
        return
    with pytest.raises(ContidError, match="has changed since the daemon read it"):
        PanelGeometry.of(describe)
    del describe["file_sha256"]  # of an earlier daemon: the limits of the axes are compared
    PanelGeometry.of(describe)
