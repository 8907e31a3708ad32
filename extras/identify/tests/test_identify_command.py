"""`contid identify` from a recording to the robot file, on simulated devices in virtual time."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from contid.errors import ContidError
from contid.robot_file.load import load_named
from contid_identify.command import command
from contid_identify.predict_command import command as predict
from contid_library.simulated import Sim

#: Pressures [bar]; the simulated regulators answer with a lag of 50 ms.
MOVES = (
    (0.2, 0.0, 0.0), (0.6, 0.1, 0.3), (0.3, 0.5, 0.0), (0.7, 0.2, 0.4), (0.1, 0.0, 0.2), (0.5, 0.4, 0.3),
)  # fmt: skip


def identify(*arguments: str) -> Result:
    return CliRunner().invoke(command, list(arguments), catch_exceptions=False)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A robot file with a moving body and a tracker, and a session of it: 15 s at 100 Hz."""
    folder = tmp_path_factory.mktemp("identify")
    text = load_named("stiffflop1").text
    sim = "sim: {dynamics: true, tracker: {noise_mm: 0.3, rate_hz: 100, latency_ms: 10}}"
    text = text.replace("    rates:", f"    {sim}\n    rates:", 1).replace("rate_hz: 500", "rate_hz: 100")
    text = text.replace("      damping_ms:", "      tip_mass_g: 15\n      damping_ms:", 1)
    file, session = folder / "arm.yaml", folder / "s.mcap"
    file.write_text(text)
    with Sim(file, record=session) as sim_run:
        for k, bars in enumerate(MOVES * 2):
            sim_run.step([*bars], ticks=300 if k == len(MOVES) - 1 else 60 + 13 * k)
    return file, session


@pytest.mark.slow
def test_from_a_session_to_the_file(recorded: tuple[Path, Path], tmp_path: Path) -> None:
    file, session = recorded
    own, page = tmp_path / "own.yaml", tmp_path / "r.html"
    own.write_text(file.read_text())
    done = identify(
        str(own), str(session), "--ring-down", "--settle", "0.1", "--write", "--html", str(page), "--json"
    )
    assert done.exit_code == 0
    found = json.loads(done.stdout.partition("\n")[0])
    for axis in found["axes"]:
        assert axis["warnings"] == []
        assert axis["lag_s"]["value"] == pytest.approx(0.05, abs=0.01)
        assert axis["stages"][2]["kept_out_rmse"] < axis["stages"][0]["kept_out_rmse"]
    assert found["tip"]["stages"][-1]["kept_out_rmse"] < found["tip"]["stages"][0]["kept_out_rmse"]
    (robot,) = load_named(str(own)).driven.values()
    assert robot.rates.shape is not None
    assert robot.rates.shape.frequency_hz == pytest.approx(
        found["ring_downs"][0]["modes"][0]["frequency_hz"]["value"], rel=1e-3
    )
    for name in robot.all_axis_names:
        lag_ms = robot.axes[name].follow_lag_ms
        assert lag_ms is not None
        assert 1.2 * 50.0 <= lag_ms <= 1.25 * 75.0  # the upper end of its interval and a quarter
        assert 0.0 < robot.axes[name].follow_least_lag_ms <= 50.0 / 1.2  # the lower end less a fifth
    assert "identified" in own.read_text()
    assert "<svg" in page.read_text()


@pytest.mark.slow
def test_a_file_of_the_tip_in_motion_predicts(recorded: tuple[Path, Path], tmp_path: Path) -> None:
    file, session = recorded
    motion, tips = tmp_path / "arm.motion.json", tmp_path / "tips.csv"
    done = identify(str(file), str(session), "--motion", str(motion))
    assert done.exit_code == 0
    assert "commands alone" in done.output
    done = CliRunner().invoke(
        predict, [str(motion), str(session), "--json", "--csv", str(tips)], catch_exceptions=False
    )
    assert done.exit_code == 0
    found = json.loads(done.stdout.partition("\n")[0])
    assert found["holds"]
    assert found["errors"][-1]["ahead_s"] is None
    assert 0.3 < found["errors"][-1]["rmse_mm"] < 5.0
    assert len(tips.read_text().splitlines()) > 500
    for arguments, message in (
        (["-o", str(tmp_path / "x.json")], "--recover"),
        (["--find-load"], "--load-g"),
        (["--find-load", "--load-g", "5"], "one of them"),
        (["--recover", "500"], "it must go on"),
    ):
        with pytest.raises(ContidError, match=message):
            CliRunner().invoke(predict, [str(motion), str(session), *arguments], catch_exceptions=False)


def test_mistakes_are_named(recorded: tuple[Path, Path], tmp_path: Path) -> None:
    _, session = recorded
    for arguments, message in (
        (["stiffflop1", str(session), "--write"], "contid new"),
        (["finger", str(session)], "robot finger"),
        (["hand", str(session)], "--robot"),
        (["stiffflop1", str(session), "--load-g", "5"], "give it once for each"),
    ):
        with pytest.raises(ContidError, match=message):
            identify(*arguments)


def test_the_time_to_settle_is_finite(recorded: tuple[Path, Path]) -> None:
    done = identify("stiffflop1", str(recorded[1]), "--settle", "nan")
    assert done.exit_code == 2
    assert "not a finite number" in done.output
