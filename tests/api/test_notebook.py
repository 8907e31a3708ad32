"""What a notebook shows of public results, read back by the standard library's parser of HTML."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from typing import Protocol, assert_type

import numpy as np
import pytest
from numpy.typing import NDArray

from contid import Client, ElasticRod, Robot, Session, Sim
from contid.errors import ContidError
from contid.html import html_table


class Shown(Protocol):
    def _repr_html_(self) -> str: ...


class Cells(HTMLParser):
    """Rows of text; every element that opens must close."""

    def __init__(self, shown: Shown) -> None:
        super().__init__()
        self.open: list[str] = []
        self.rows: list[list[str]] = []
        self.captions: list[str] = []
        self.feed(shown._repr_html_())
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        elif tag in ("th", "td"):
            self.rows[-1].append("")
        elif tag == "caption":
            self.captions.append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open[-1] == "caption":
            self.captions[-1] += data
        else:
            self.rows[-1][-1] += data


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("session") / "<b>.mcap"
    with Sim("hand", record=path) as sim:
        sim.step({"left": [50, 60], "right": [60, 70]}, ticks=40)
        shown = Cells(sim)
        assert [row[:2] for row in shown.rows[1:]] == [
            ["left", sim.state["left"].mode],
            ["right", "APPROACH"],
        ]
        left = [float(each) for each in shown.rows[1][2].strip("[]").split(",")]
        assert left == pytest.approx(sim.state["left"].command, rel=1e-4)
    return path


def test_a_robot_is_its_axes_with_their_limits() -> None:
    shown = Cells(Robot("hand"))
    assert shown.rows.count(["left_mm", "0", "100", "60"]) == 2
    assert [caption.split(":")[0] for caption in shown.captions] == ["left", "right"]
    assert Cells(Robot("hand")["left"]).captions == shown.captions[:1]


@pytest.mark.parametrize(("shape", "rows"), [((2,), 1), ((3, 2), 3), ((2, 6, 2), 10), ((0, 2), 0)])
def test_answers_are_a_table_of_at_most_ten_rows(shape: tuple[int, ...], rows: int) -> None:
    answer = Robot("finger").ik(np.broadcast_to([20.0, 80.0], shape))
    shown = Cells(answer)
    assert shown.rows[0] == [*(answer.dtype.names or ())]
    assert len(shown.rows) == 1 + rows
    assert all(row[2] == "True" for row in shown.rows[1:])


def test_names_are_not_elements(recording: Path) -> None:
    shown = Cells(Session(recording))
    assert shown.captions == [f"{recording}: 200 Hz in virtual time"]
    assert shown.rows[1] == ["left", "rack_finger", "left, right"]
    assert "<i>" not in html_table("", ["<i>"], [["<i>"]])


def test_a_plot_has_the_numbers_of_the_table(recording: Path) -> None:
    pytest.importorskip("matplotlib").use("Agg")
    session = Session(recording)
    figure = session.plot()
    rows = list(session)
    assert len(figure.axes) == 2
    lines = figure.axes[0].get_lines()
    names = [
        "command.left.left_mm",
        "measured.left.left_mm",
        "command.left.right_mm",
        "measured.left.right_mm",
    ]
    assert len(lines) == len(names)
    for line, name in zip(lines, names, strict=True):
        t_s, values = line.get_data()
        assert np.array_equal(t_s, [row["t_s"] for row in rows])
        assert np.array_equal(values, [row[name] for row in rows], equal_nan=True)
    figure.clear()


def test_a_plot_of_a_session_whose_robot_file_is_refused_names_it(recording: Path) -> None:
    pytest.importorskip("matplotlib").use("Agg")
    session = Session(recording)
    session.metadata["robot_file"]["text"] = "contid: 1\nnam: hand\n"
    with pytest.raises(ContidError, match="its robot file is refused"):
        session.plot()


def _types_of_the_public_interface() -> None:
    """Never called: ``mypy --strict`` reads it. No result is ``Any``."""
    robot = Robot("finger")
    answer, pose = robot.ik([20, 80]), robot.fk([60, 60])
    assert_type(answer.actuation, NDArray[np.float64])
    assert_type(answer.converged, NDArray[np.bool_])
    assert_type(pose.tip, NDArray[np.float64])
    assert_type(robot.jacobian([60, 60]), NDArray[np.float64])
    assert_type(robot.workspace().points, NDArray[np.float64])
    assert_type(robot.limits.min, NDArray[np.float64])
    assert_type(ElasticRod(1, 1, modulus_pa=1, poisson=0).statics([1]).points, NDArray[np.float64])
    assert_type(Sim("finger").step([60, 60])["finger"].command, NDArray[np.float64])
    assert_type(next(iter(Session("x")))["t_s"], float)
    assert_type(Client().ping(), None)
