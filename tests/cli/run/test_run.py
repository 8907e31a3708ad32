"""`contid run` as a user meets it: exit codes and bad input."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.cli.run.running import enabled, journal
from tests.support.command import contid
from tests.support.fingers import circle_csv
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]


def test_real_time_follows_a_circle_and_reports(robot: Callable[..., Path]) -> None:
    done = contid("run", str(robot(2)), "--json", stdin=circle_csv(2, period_s=0.5))
    report = json.loads(done.stdout)
    assert (done.returncode, report["exit_code"]) == (0, 0), done.stderr
    for each in report["robots"].values():
        assert each["mode"] == "OFF"
        assert each["ticks_followed"] > 50
    assert set(report["lateness"]) == {"p50_us", "p99_us", "p99_9_us", "max_us"}


def test_virtual_and_real_time_command_the_same(robot: Callable[..., Path], tmp_path: Path) -> None:
    """Tick by tick the same bytes, as far as no tick was skipped on this machine."""
    path, given = str(robot(1)), circle_csv(1, period_s=0.5)
    logs: list[Any] = []
    skipped = 0
    for virtual in (["--virtual"], []):
        log = tmp_path / f"log{len(logs)}.csv"
        done = contid("run", path, *virtual, "--log", str(log), "--json", stdin=given)
        assert done.returncode == 0, done.stderr
        skipped += json.loads(done.stdout)["skipped"]
        logs.append([line.split(",", 1)[1] for line in log.read_text().splitlines()])
    if skipped == 0:
        assert logs[0] == logs[1]


BAD = {
    "nan": ("t_s,f0.x_mm,f0.y_mm\n0,50,75\n1,nan,75\n", "3:3"),
    "inf": ("t_s,f0.x_mm,f0.y_mm\n0,50,75\n1,50,inf\n", "3:6"),
    "missing column": ("t_s,f0.x_mm\n0,50\n", "1:"),
    "missing cell": ("t_s,f0.x_mm,f0.y_mm\n0,50,75\n1,50\n", "3:"),
    "time backwards": ("t_s,f0.x_mm,f0.y_mm\n0,50,75\n2,50,75\n1,50,75\n", "4:1"),
    "unreachable": ("t_s,f0.x_mm,f0.y_mm\n0,50,75\n1,500,75\n", "3:1"),
    "unknown robot": ("t_s,thumb.x_mm,thumb.y_mm\n0,50,75\n", "1:5"),
    "empty": ("t_s,f0.x_mm,f0.y_mm\n", "1:1"),
}


@pytest.mark.parametrize("name", list(BAD))
def test_bad_input_is_named_and_nothing_moves(name: str, robot: Callable[..., Path], tmp_path: Path) -> None:
    given, place = BAD[name]
    done = contid("run", str(robot(1)), stdin=given)
    assert done.returncode == 2
    assert f"stdin:{place}" in done.stderr
    assert journal(tmp_path) == []


def test_an_unreachable_point_names_its_limit_and_the_distance(robot: Callable[..., Path]) -> None:
    done = contid("run", str(robot(1)), stdin=BAD["unreachable"][0])
    assert "f0: tip (500, 75, 0) mm is out of reach by" in done.stderr
    assert "left.max" in done.stderr


def test_nearest_goes_there_all_the_same(robot: Callable[..., Path]) -> None:
    given = "t_s,f0.x_mm,f0.y_mm\n0,50,75\n2,60,120\n"
    done = contid("run", str(robot(1)), "--virtual", "--unreachable", "nearest", "--json", stdin=given)
    report = json.loads(done.stdout)
    assert done.returncode == 0, done.stderr
    assert report["robots"]["f0"]["ticks_unreachable"] > 0


def test_a_stream_reports_a_bad_row_and_goes_on(robot: Callable[..., Path]) -> None:
    rows = ["f0.x_mm,f0.y_mm", "50,75", "51,x", "52,75", "500,75", "53,75"]
    done = contid("run", str(robot(1)), "--virtual", "--json", stdin="\n".join([*rows, ""]))
    assert done.returncode == 0, done.stderr
    assert "stdin:3:4" in done.stderr
    assert "stdin:5:1" in done.stderr


def test_a_live_stream_in_real_time_holds_on_bad_rows_and_ends_with_its_input(
    robot: Callable[..., Path], tmp_path: Path, started: Callable[..., Any]
) -> None:
    log = tmp_path / "log.csv"
    process = started(str(robot(1)), "--log", str(log))
    process.stdin.write("f0.x_mm,f0.y_mm\n50,75\n")
    process.stdin.flush()
    until(enabled(tmp_path), "armed")

    def modes() -> list[str]:
        rows = [line.split(",")[2] for line in log.read_text().splitlines()[1:] if line.count(",") == 6]
        return [mode for mode, before in zip(rows, ["", *rows], strict=False) if mode != before]

    for row, mode in (
        ("", "RUN"),
        ("51,oops", "HOLD"),
        ("51,75", "RUN"),
        ("999,75", "HOLD"),
        ("50,75", "RUN"),
    ):
        process.stdin.write(row + "\n" if row else "")
        process.stdin.flush()
        until(lambda mode=mode: modes()[-1:] == [mode], mode)  # type: ignore[misc]
    out, err = process.communicate(timeout=30)
    assert process.returncode == 0, out + err
    assert "stdin:3:4" in err
    assert "stdin:5:1" in err
    assert modes()[-1] == "OFF"


@pytest.mark.parametrize(
    ("last", "message"),
    [
        ("51,oops\n", "holding"),
        ("51,", "may be cut off"),
        ("51,7", "may be cut off"),
        ("999,75\n", "holding"),
    ],
)
@pytest.mark.parametrize("virtual", [False, True], ids=["real", "virtual"])
def test_a_stream_that_ends_on_a_bad_row_reports_it_and_does_not_follow_it(
    last: str, message: str, virtual: bool, robot: Callable[..., Path], tmp_path: Path
) -> None:
    log = tmp_path / "log.csv"
    given = "f0.left_mm,f0.right_mm\n60,75\n" + last
    done = contid("run", str(robot(1)), "--log", str(log), *(["--virtual"] if virtual else []), stdin=given)
    assert done.returncode == 2, done.stderr
    assert "the last row " + ("of f0 " if message == "holding" else "") + "was not followed" in done.stdout
    assert "stdin:3:" in done.stderr
    assert message in done.stderr
    assert ("stdin: 1 of 2 rows held robots" in done.stdout) == (message == "holding")
    head, *lines = [line.split(",") for line in log.read_text().splitlines()]
    commands = [cell for line in lines if (cell := line[head.index("f0.right.command")])]
    assert all(float(command) > 0.05 for command in commands)


@pytest.mark.parametrize(
    ("rows", "refused"), [("", 0), ("\n", 0), ("50,7", 0), ("999,75\nx,75\n", 2)], ids=repr
)
@pytest.mark.parametrize("virtual", [False, True], ids=["real", "virtual"])
def test_a_stream_of_which_no_row_could_be_followed_is_no_success(
    rows: str, refused: int, virtual: bool, robot: Callable[..., Path]
) -> None:
    """The robots had not moved, and the exit code was 0."""
    given = "f0.left_mm,f0.right_mm\n" + rows
    done = contid("run", str(robot(1)), "--json", *(["--virtual"] if virtual else []), stdin=given)
    report = json.loads(done.stdout)
    assert (done.returncode, report["exit_code"]) == (2, 2)
    assert report["ending"] == "stdin: no row could be followed"
    assert report["problems"] == ([f"stdin: {refused} of {refused} rows held robots"] if refused else [])


def test_a_device_that_is_not_there_is_exit_code_4(robot: Callable[..., Path]) -> None:
    path = robot(1, options="faults: [{at_s: 0.0, kind: lost}]")
    done = contid("run", str(path), stdin=circle_csv(1))
    assert done.returncode == 4
    assert "bus0" in done.stdout


def test_a_fault_is_exit_code_3_and_reports(robot: Callable[..., Path]) -> None:
    path = robot(2, options="faults: [{at_s: 0.3, kind: overload, axis: f0.left}]")
    done = contid("run", str(path), "--json", stdin=circle_csv(2, period_s=0.6))
    report = json.loads(done.stdout)
    assert done.returncode == 3
    assert report["robots"]["f0"]["fault"] == 103
    assert "clear-fault" in report["robots"]["f0"]["message"]
    assert report["ticks"] > 0
