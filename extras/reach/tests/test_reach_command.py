"""What `contid reach` prints and refuses, without the work of a real map."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from contid.errors import ContidError
from contid.robot_file.load import load_named
from contid_reach import quality, report
from contid_reach.command import command
from contid_reach.quality import Measure, _isotropy, quality_map
from contid_reach.report import ReachReport
from contid_reach.spatial import Volume


def test_fewer_axes_than_directions_have_no_dexterity() -> None:
    random = np.random.default_rng(3)
    for axes in (1, 2):
        assert _isotropy(random.normal(size=(3, axes))) == 0.0
    assert _isotropy(np.array([[2.0]])) == 1.0
    assert _isotropy(np.diag([1.0, 4.0, 2.0])) == pytest.approx(0.25)


def test_a_map_without_a_value_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quality, "_measure_of", lambda *arguments: lambda actuation: float("nan"))
    (robot,) = load_named("finger").driven.values()
    with pytest.raises(ContidError, match="left: no accuracy is known: no stable equilibrium at"):
        quality_map("left", robot, Measure.ACCURACY, across=4)


def test_a_mixed_file_is_one_object(monkeypatch: pytest.MonkeyPatch) -> None:
    (finger,), (arm,) = (load_named(name).driven.values() for name in ("finger", "bend1"))
    loaded = SimpleNamespace(file=SimpleNamespace(name="both"), driven={"finger": finger, "arm": arm})
    volume = Volume({(0, 0, 0): ()}, 0.01, 1)
    monkeypatch.setattr("contid.robot_file.load.load_named", lambda name: loaded)
    monkeypatch.setattr(report, "planar_report", lambda robots: ReachReport(areas_cm2={"finger": 2.0}))

    def spatial(*arguments: Any) -> ReachReport:
        return ReachReport(volumes_cm3={"arm": 1.0}, volumes={"arm": volume})

    monkeypatch.setattr(report, "spatial_report", spatial)
    done = CliRunner().invoke(command, ["both", "--json"], catch_exceptions=False)
    found = json.loads(done.stdout)
    assert (found["area_cm2"], found["volume_cm3"]) == ({"finger": 2.0}, {"arm": 1.0})


@pytest.mark.parametrize("options", [(), ("--quality", "dexterity")])
def test_a_plot_that_cannot_be_written_is_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...]
) -> None:
    def late(*arguments: object, **named: object) -> None:
        raise AssertionError("work was done before")

    monkeypatch.setattr(report, "planar_report", late)
    monkeypatch.setattr(quality, "quality_map", late)
    done = CliRunner().invoke(command, ["finger", "--plot", "/proc/x.png", *options])
    assert isinstance(done.exception, ContidError)
    assert str(done.exception).startswith("/proc/x.png: cannot write it: ")
    absent = tmp_path / "absent"
    done = CliRunner().invoke(command, ["finger", "--plot", str(absent / "x.png"), *options])
    assert done.exit_code == 2
    assert f"'{absent / 'x.png'}': there is no folder '{absent}'" in done.output
    assert not any(tmp_path.iterdir())
