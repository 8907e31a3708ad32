"""``contid check``: the report, and bad files with exit code 2."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest
from click.testing import CliRunner

from contid.cli.commands.check import command
from tests.support.command import contid_in

pytestmark = pytest.mark.process


def test_the_report_names_robots_axes_buses_limits_rate_and_placeholders() -> None:
    done = CliRunner().invoke(command, ["hand"])
    assert done.exit_code == 0, done.output
    for message in (
        "hand: 2 robots at 200 Hz",
        "left",
        "right",
        "servos",
        "dynamixel",
        "100",
        "id 4",
        "velocity",
    ):
        assert message in done.output
    assert "placeholder values, measure these on your robot: geometry.rack_spacing_mm" in done.output


def test_a_port_with_brackets_is_printed_as_it_is(configs: Path, tmp_path: Path) -> None:
    text = (configs / "hand.yaml").read_text()
    port = next(line for line in text.splitlines() if "port:" in line).split()[1]
    file = tmp_path / "hand.yaml"
    file.write_text(text.replace(port, '"/dev/[left]/[/x]"'))
    done = CliRunner().invoke(command, [str(file)])
    assert done.exit_code == 0, done.output
    assert "/dev/[left]/[/x]" in done.output


def test_the_report_names_the_links_of_a_chain_and_a_chosen_inverse(configs: Path, tmp_path: Path) -> None:
    done = CliRunner().invoke(command, [str(configs / "chain.yaml")])
    assert done.exit_code == 0, done.output
    for message in (
        "link 1: arm left on its base at (0, 0, 0) mm",
        "link 2: rope of 1000 mm, 50 g, pinned at both ends, one curve",
        "link 3: arm right on its base at (700, 0, 0) mm",
        "bases 700 mm apart; the rope stays above z = -150 mm",
        "placeholder values, measure these on your robot: floor_mm, links",
    ):
        assert message in done.output
    text = (configs / "chain.yaml").read_text()
    other = tmp_path / "chain.yaml"
    other.write_text(
        text.replace("mass_g: 50, ", "").replace("tri_tube\n", "tri_tube\n    solver: {method: ph}\n")
    )
    done = CliRunner().invoke(command, [str(other)])
    assert "rope of 1000 mm, mass not stated" in done.output
    assert done.output.count("inverse: ph") == 2
    report = json.loads(CliRunner().invoke(command, [str(other), "--json"]).stdout)
    rope = report["robots"][2]["chain"]
    assert (rope["bases_apart_mm"], rope["length_mm"], rope["mass_g"]) == (700, 1000, None)


@pytest.mark.parametrize("name", ["finger", "hand"])
def test_the_report_as_json(configs: Path, name: str) -> None:
    done = CliRunner().invoke(command, [str(configs / f"{name}.yaml"), "--json"])
    report = json.loads(done.stdout)
    assert report["rate_hz"] == 200
    for robot in report["robots"]:
        assert [(axis["min"], axis["max"]) for axis in robot["axes"]] == [(0, 100), (0, 100)]


def test_a_bad_file_as_json_is_one_line_per_mistake(tmp_path: Path, configs: Path) -> None:
    bad = tmp_path / "bad.yaml"
    text = (configs / "finger.yaml").read_text()
    bad.write_text(text.replace("rate_hz: 200", "rate_hz: 0").replace("gap_mm: 5", "gap_mm: -5"))
    done = CliRunner().invoke(command, [str(bad), "--json"])
    assert done.exit_code == 2
    found = [json.loads(line) for line in done.stdout.splitlines()]
    lines = text.splitlines()
    wrong = [lines[each["line"] - 1] for each in found]
    assert ["rate_hz" in wrong[0], "gap_mm" in wrong[1]] == [True, True]
    assert all(each["file"] == str(bad) and each["column"] > 1 for each in found)


CIRCLE = "path circle --center 20,80 --radius 10 --period {period} --for finger"


def contid(words: str, folder: Path, text: str = "") -> subprocess.CompletedProcess[str]:
    return contid_in(folder, *words.split(), stdin=text)


def test_a_trajectory_is_checked_as_a_run_checks_it(tmp_path: Path) -> None:
    good = contid(CIRCLE.format(period=3), tmp_path).stdout
    (tmp_path / "good.csv").write_text(good)
    done = contid("check finger good.csv", tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("good.csv: 151 rows in 3 s: within reach and limits of finger")
    assert contid("check finger -", tmp_path, good).stdout.startswith("stdin: 151 rows in 3 s")
    assert json.loads(contid("check finger good.csv --json", tmp_path).stdout)["rows"] == 151


@pytest.mark.parametrize(
    "text",
    [
        "t_s,x_mm,y_mm\n0,20,80\n1,20,900\n",  # out of reach
        "t_s,x_mm,y_mm\n0,20,80\n0.1,20,60\n",  # too fast
        "t_s,x_mm,y_mm\n0,20,80\n0,20,60\n",  # times repeat
        "t_s,x_m,y_mm\n0,20,80\n",  # a wrong column
        "",
    ],
)
def test_check_and_run_refuse_with_the_same_message(text: str, tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_text(text)
    checked = contid("check finger bad.csv", tmp_path)
    run = contid("run finger --virtual --trajectory bad.csv", tmp_path)
    assert (checked.returncode, checked.stdout) == (2, "")
    assert (run.returncode, run.stderr) == (2, checked.stderr)
    as_json = contid("check finger bad.csv --json", tmp_path)
    assert as_json.returncode == 2
    assert all(json.loads(line)["file"] == "bad.csv" for line in as_json.stdout.splitlines())


@pytest.mark.parametrize(("scale", "metres"), [(1.0, False), (1e-3, True)])
def test_metres_in_a_column_of_millimetres_are_suspected(scale: float, metres: bool, tmp_path: Path) -> None:
    rows = "".join(f"{k},{20 * scale!r},{300 * scale!r}\n" for k in range(3))
    done = contid("check finger -", tmp_path, f"t_s,x_mm,y_mm\n{rows}")
    assert (done.returncode, "are these metres in a mm column?" in done.stderr) == (2, metres), done.stderr


def test_a_live_stream_cannot_be_checked(tmp_path: Path) -> None:
    done = contid("check finger -", tmp_path, "x_mm,y_mm\n20,80\n")
    assert done.returncode == 2
    assert "no column 't_s'" in done.stderr
