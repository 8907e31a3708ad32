"""From a table to a trajectory: every verdict, and paths against their formula and against SciPy's spline."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from contid.errors import BadInputError, ContidError
from contid_adapt.adapt import Adapted, adapt
from contid_adapt.meaning.expression import affine, parse
from contid_adapt.meaning.mapping import read_mapping

T = np.arange(400) / 100.0
X = 20.0 + 5.0 * np.sin(np.pi / 2 * T) ** 2
Y = 80.0 + 3.0 * (1.0 - np.cos(np.pi / 2 * T))
MAP = "t_s: t\nx_mm, y_mm: [x, y]\nframe: robot\n"


def table(*columns: NDArray[Any], names: str = "t,x,y", form: str = "%.6f") -> str:
    rows = "\n".join(",".join(form % value for value in row) for row in zip(*columns, strict=True))
    return f"{names}\n{rows}\n"


@pytest.fixture
def made(tmp_path: Path):
    def make(text: str, mapping: str = MAP, robot: str = "finger") -> Adapted:
        path = tmp_path / "a.csv"
        path.write_text(text)
        return adapt(path, robot, mapping, "map.yaml")

    return make


def test_a_plain_table_is_written_as_it_is(made) -> None:
    found = made(table(T, X, Y))
    assert found.names == ("t_s", "x_mm", "y_mm")
    np.testing.assert_allclose(found.rows, np.column_stack([T, X, Y]), atol=1e-6)
    assert "within reach" in found.accepted


def test_a_bend_that_changes_moves(made) -> None:
    mapping = "t_s: t\ns1.bend_deg: bend\ns1.azimuth_deg: 0\nframe: axes\n"
    found = made(table(T, X, names="t,bend"), mapping, "bend1")
    assert found.names == ("t_s", "s1.bend_deg", "s1.azimuth_deg")
    np.testing.assert_allclose(found.rows[:, 1], X, atol=1e-6)


@pytest.mark.parametrize(
    ("text", "mapping", "place", "words"),
    [
        pytest.param(table(T, X, Y), "t_s: t\nx_mm, y_mm: [x, y]\n", "map.yaml:1", "no frame", id="no frame"),
        pytest.param(table(T * 1e3, X, Y), MAP, "map.yaml:1", "in ms?", id="time in ms"),
        pytest.param(
            table(T / 1e3, X, Y, form="%.9f"), MAP, "map.yaml:1", "1e-05 s apart", id="time too short"
        ),
        pytest.param(
            table(T, X, Y, names="t_ms,x,y"),
            MAP.replace(": t", ": t_ms"),
            "map.yaml:1",
            "is in ms",
            id="unit of time",
        ),
        pytest.param(table(T, X / 1e3, Y / 1e3), MAP, "", "nothing moves", id="metres"),
        pytest.param(
            table(T, X, Y, names="t,x_m,y_m"),
            MAP.replace("[x, y]", "[x_m, y_m]"),
            "map.yaml:2",
            "is in m (1000 mm each)",
            id="unit in the name",
        ),
        pytest.param(table(T, 0 * X, 0 * Y + 80), MAP, "", "nothing moves", id="still"),
        pytest.param(table(T, X, Y), MAP.replace("[x, y]", "[-x, y]"), "map.yaml:3", "left one", id="sign"),
        pytest.param(table(T, X, Y), MAP.replace("[x, y]", "[y, x]"), "map.yaml:3", "left one", id="swapped"),
        pytest.param(table(T, X, Y), MAP.replace("robot", "{x: -x}"), "map.yaml:3", "left one", id="mirror"),
        pytest.param(
            table(np.r_[T, T], np.r_[X, X], np.r_[Y, Y]), MAP, "a.csv:402", "runs back", id="two runs"
        ),
        pytest.param(table(T, X, Y) + table(T, X, Y), MAP, "a.csv:403", "2 sessions", id="two headers"),
        pytest.param(table(np.floor(T), X, Y), MAP, "a.csv:3", "clock is rounded", id="rounded clock"),
        pytest.param(
            table(np.repeat(T, 2), np.repeat(X, 2) + np.tile([0, 9], 400), np.repeat(Y, 2)),
            MAP,
            "a.csv:3",
            "bodies",
            id="two bodies",
        ),
        pytest.param(table(np.where(T > 2, T + 2, T), X, Y), MAP, "a.csv:203", "`gap_s: 2.1`", id="gap"),
        pytest.param(
            table(T, X, Y).replace("0.030000,", "0.03o000,"), MAP, "a.csv:5:1", "not a number", id="letter"
        ),
        pytest.param(
            table(T, X, Y).replace("0.030000,20", "0.030000;20"), MAP, "a.csv:5", "2 cells", id="separator"
        ),
        pytest.param(table(T, X, Y)[:-13], MAP, "a.csv:401", "ends within a row", id="cut"),
        pytest.param(
            table(T, X, Y, names=",t,x,y"), MAP, "a.csv:1:1", "4 names above rows of 3", id="shifted"
        ),
        pytest.param(table(T, X, Y, names="t,x,x"), MAP, "a.csv:1:5", "write c2 or c3", id="names twice"),
        pytest.param(table(T, X, Y, names="x,y,t"), MAP, "map.yaml:1", "a second", id="names shifted"),
        pytest.param(table(T, X + 500, Y), MAP, "a.csv:2", "out of reach", id="out of reach"),
        pytest.param(
            table(T, X, Y), MAP.replace("[x, y]", "[x, x]"), "map.yaml:2", "'x' is x_mm already", id="x twice"
        ),
        pytest.param(
            table(T, 0 * X + 2, Y, names="t,tip_c,tip_y"),
            MAP.replace("[x, y]", "[tip_c, tip_y]"),
            "map.yaml:2",
            "'tip_c' never changes",
            id="a column of confidence",
        ),
        pytest.param(
            table(T * 1e9, X, Y, form="%.0f"),
            MAP.replace(": t", ": 1e-6*t"),
            "map.yaml:1",
            "1000 times too large",
            id="ns as us",
        ),
        pytest.param(table(T, X, Y), MAP + "rate_hz: 100", "map.yaml:4", "one of them", id="time and rate"),
        pytest.param(table(T, X, Y), MAP.replace("t_s: t\n", ""), "map.yaml:1", "no time", id="no time"),
        pytest.param(table(T, X, Y), MAP + "z_nm: x", "map.yaml:4", "no column 'z_nm'", id="unknown column"),
        pytest.param(
            table(T, X, Y),
            MAP.replace("t\n", "__import__('os').getcwd()\n", 1),
            "map.yaml:1",
            "not understood",
            id="Python",
        ),
        pytest.param(table(T, X, Y), MAP + "rows: x > 100\n", "map.yaml:4", "no row", id="no row"),
        pytest.param(
            table(T, X, Y), MAP + "# a\n" * 9 + "gap_s: 1\n" * 7, "map.yaml:1", "at most 8", id="nine lines"
        ),
        pytest.param(table(T, X, Y), MAP + "frame: robot\n", "map.yaml:4", "stands twice", id="key twice"),
    ],
)
def test_what_is_refused(made, text: str, mapping: str, place: str, words: str) -> None:
    with pytest.raises(ContidError, match=re.escape(words)) as refused:
        made(text, mapping)
    assert f"{place}:" in str(refused.value)


def test_time_of_epochs_is_subtracted_as_integers(made) -> None:
    start = 1403636580838555648
    rows = [f"{start + 10_000_000 * k},{x:.6f},{y:.6f}" for k, (x, y) in enumerate(zip(X, Y, strict=True))]
    found = made("#timestamp [ns],x,y\n" + "\n".join(rows) + "\n", MAP.replace("t\n", "1e-9*timestamp\n", 1))
    np.testing.assert_allclose(found.rows[:, 0] - found.rows[0, 0], T, atol=2e-9)


def test_seconds_and_nanoseconds_of_a_message_are_one_time(made) -> None:
    whole = np.floor(0.5 + T)
    text = "secs,nsecs,x,y\n" + "".join(
        f"{1464265231 + int(s)},{round((0.5 + t - s) * 1e9)},{x:.6f},{y:.6f}\n"
        for t, s, x, y in zip(T, whole, X, Y, strict=True)
    )
    found = made(text, MAP.replace("t\n", "secs + 1e-9*nsecs\n", 1))
    np.testing.assert_allclose(found.rows[:, 0] - found.rows[0, 0], T, atol=2e-9)


def test_a_counter_of_32_bits_wraps(made) -> None:
    ticks = (2.0**32 - 1000.0 + 10.0 * np.arange(400)) % 2.0**32
    found = made(table(ticks, X, Y, names="tick,x,y"), MAP.replace("t\n", "1e-3*tick\n", 1))
    np.testing.assert_allclose(np.diff(found.rows[:, 0]), 0.01, atol=1e-6)
    assert any("wrapped once" in note or "wrapped 1 times" in note for note in found.notes)


def test_lost_samples_are_left_out_and_counted(made) -> None:
    lines = table(T, X, Y).splitlines()
    lines[100:105] = [line.split(",")[0] + ",," for line in lines[100:105]]
    lines[200] = lines[200].split(",")[0] + ",0,0"
    found = made("\n".join(lines) + "\n")
    assert len(found.rows) == 394
    assert any("6 of 400" in note for note in found.notes)


def test_a_path_that_begins_at_zero_keeps_its_first_row(made) -> None:
    found = made(table(T, X - X[0], Y - Y[0]), MAP.replace("robot", "{origin: first, at: rest}"))
    assert len(found.rows) == 400


def test_a_clock_that_is_rounded_agrees_with_the_rate_that_the_file_states(made) -> None:
    text = "Format Version,1.23,Export Frame Rate,360,Length Units,Millimeters\n\n"
    t = np.floor(1000 * np.arange(400) / 360) / 1000
    found = made(
        text + table(t, X, Y, names="Time,X,Y"), "t_s: Time\nx_mm, y_mm: [X, Y]\nframe: robot\nsmooth_mm: 1\n"
    )
    assert any("clock is rounded: steps of 0.003" in note for note in found.notes)


def test_held_samples_are_refused_with_the_remedy_and_smoothed_back(made) -> None:
    held = 2 * (np.arange(400) // 2)
    with pytest.raises(BadInputError, match="samples are held for several rows: `smooth_mm"):
        made(table(T, X[held], Y[held]))
    found = made(table(T, X[held], Y[held]), MAP + "smooth_mm: 0.5\n")
    t = found.rows[:, 0]
    assert np.abs(found.rows[:, 1] - (20.0 + 5.0 * np.sin(np.pi / 2 * t) ** 2)).max() < 0.02


def test_noise_is_smoothed_as_by_the_spline_of_scipy(made) -> None:
    interpolate = pytest.importorskip("scipy.interpolate")
    rng = np.random.default_rng(0)
    noisy = X + rng.normal(0, 0.05, 400), Y + rng.normal(0, 0.05, 400)
    with pytest.raises(BadInputError, match="`smooth_mm"):
        made(table(T, *noisy))
    found = made(table(T, *noisy), MAP + "smooth_mm: 0.5\n")
    for column, values in zip(found.rows[:, 1:].T, noisy, strict=True):
        spline = interpolate.make_smoothing_spline(T, values)
        assert np.abs(spline(found.rows[:, 0]) - column).max() < 0.1
    note = next(note for note in found.notes if "smoothed" in note)
    moved = float(re.search(r"([\d.]+) mm at most", note)[1])  # type: ignore[index]
    assert moved == pytest.approx(np.hypot(*(found.rows[:, 1:].T - np.array(noisy))).max(), rel=0.01)


def test_a_quaternion_gives_the_direction_and_its_mistakes_are_refused(made) -> None:
    angle = 0.02 * np.sin(np.pi / 2 * T) ** 2
    x, z = 2.0 * np.sin(np.pi / 2 * T) ** 2, np.full(400, 80.0)
    columns = (T, x, 0 * T, z, 0 * T, np.sin(angle), 0 * T, np.cos(angle))
    text = table(*columns, names="t,x,y,z,qx,qy,qz,qw", form="%.9f")
    mapping = "t_s: t\nx_mm, y_mm, z_mm: [x, y, z]\n{}\nframe: {{origin: [0, 0, 80], at: [0, 0, 80]}}\n"
    from contid_adapt.adapt import mean
    from contid_adapt.reading.read import read_table

    def run(turn: str, text: str = text) -> Adapted:
        with pytest.raises(ContidError):
            made(text, "x_mm: x")  # Writes the file.
        return mean(
            read_table(made.__closure__[0].cell_contents / "a.csv"), "stiffflop2", mapping.format(turn)
        )

    found = run("quaternion_xyzw: [qx, qy, qz, qw, z]")
    np.testing.assert_allclose(found.rows[:, 4], np.sin(2 * angle), atol=1e-6)
    np.testing.assert_allclose(found.rows[:, 6], np.cos(2 * angle), atol=1e-6)
    with pytest.raises(ContidError, match="'qx' stands where wxyz has 'w'"):
        run("quaternion_wxyz: [qx, qy, qz, qw, z]")
    broken = table(*columns[:-1], 0.9 * columns[-1], names="t,x,y,z,qx,qy,qz,qw", form="%.9f")
    with pytest.raises(ContidError, match=r"a\.csv:2:.*norm 0\.9"):
        run("quaternion_xyzw: [qx, qy, qz, qw, z]", broken)


def test_a_rigid_fit_finds_the_frame_and_states_its_residual(made) -> None:
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    points = np.column_stack([X, Y, 0 * X])
    own = (points - [5.0, 6.0, 7.0]) @ turn
    corners = np.array([[0.0, 0, 0], [100, 0, 0], [0, 100, 0], [0, 0, 100]])
    pairs = [[*map(float, (corner - [5.0, 6.0, 7.0]) @ turn), *map(float, corner)] for corner in corners]
    mapping = f"t_s: t\nx_mm, y_mm, z_mm: [x, y, z]\nframe: {{fit: {pairs}}}\n"
    found = made(table(T, *own.T, names="t,x,y,z"), mapping)
    np.testing.assert_allclose(found.rows[:, 1:], points[:, :2], atol=1e-5)
    pairs[0][3] += 30.0
    with pytest.raises(BadInputError, match="mm rms only"):
        made(
            table(T, *own.T, names="t,x,y,z"),
            f"t_s: t\nx_mm, y_mm, z_mm: [x, y, z]\nframe: {{fit: {pairs}}}\n",
        )


def test_axes_need_no_frame_of_positions_but_the_word(made) -> None:
    left, right = 60 + 5 * np.sin(np.pi / 2 * T) ** 2, 70 + 0 * T
    found = made(table(T, left, right, names="t,l,r"), "t_s: t\nleft_mm, right_mm: [l, r]\nframe: axes\n")
    assert found.names == ("t_s", "left_mm", "right_mm")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 + 2*3", 7.0),
        ("-(1 - 4)/2", 1.5),
        ("1e-3*2.5", 0.0025),
        ("deg(rad(90))", 90.0),
        ("2 - 3 - 4", -5.0),
    ],
)
def test_expressions_of_numbers(text: str, value: float) -> None:
    form = affine(parse(text))
    assert form is not None
    assert form.constant == pytest.approx(value)


@pytest.mark.parametrize(
    "text", ["", "1 +", "(1", "x y", "f(x)", "x;y", "lambda: 1", "x[", "1..2", "a.b()", "(" * 99]
)
def test_expressions_that_are_none(text: str) -> None:
    with pytest.raises(ContidError):
        parse(text)


def test_random_mappings_end_with_no_other_error() -> None:
    rng = np.random.default_rng(1)
    for _ in range(300):
        letters = list(MAP)
        for place in rng.integers(len(letters), size=3):
            letters[place] = chr(int(rng.integers(32, 127)))
        with contextlib.suppress(BadInputError):
            read_mapping("".join(letters), "m", ["x_mm", "y_mm"])
