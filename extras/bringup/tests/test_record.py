"""The page of a bring-up is written whatever the name of the file and the findings are."""

from __future__ import annotations

import os
from datetime import datetime
from pathlib import Path

from contid.hal.pulses import ProvenDevice
from contid.robot_file.load import load_named, load_robot_file
from contid_bringup.record import ProvenAxis, write_page, write_section

WHEN = datetime(2026, 11, 28, 14, 30)


def test_a_name_that_is_not_utf_8_and_findings_with_brackets(tmp_path: Path) -> None:
    path, page = Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9.yaml")), tmp_path / "page.html"
    path.write_text(load_named("finger").text)
    device = ProvenDevice("XL330 <3> & co", "43")
    record = ProvenAxis("finger.left", "ok", device, "0123456789e0", ["a < b", "✓"])
    write_section(path, [record], WHEN)
    write_page(page, path, load_robot_file(path), [record], WHEN)
    text = page.read_text(encoding="utf-8")
    assert "caf\\udce9.yaml" in text
    assert "XL330 &lt;3&gt; &amp; co" in text
    assert "a &lt; b<br>✓" in text
    assert load_robot_file(path).file.bringup["finger.left"].wiring == "0123456789e0"


def test_what_another_bring_up_wrote_meanwhile_stays(tmp_path: Path) -> None:
    """Of two buses at once, the one that ended last wrote what it had read at its start."""
    path = tmp_path / "finger.yaml"
    path.write_text(load_named("finger").text)
    device = ProvenDevice("XL330 3", "43")
    begun = load_robot_file(path)
    for axis in ("finger.left", "finger.right"):
        record = ProvenAxis(axis, "ok", device, "0123456789e0", [])
        write_section(path, [record], WHEN)
        write_page(tmp_path / "page.html", path, begun, [record], WHEN)
    assert load_robot_file(path).file.bringup.keys() == {"finger.left", "finger.right"}
