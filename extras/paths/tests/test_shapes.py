"""Shapes: where they go, that they close, and that their rows are on the tick."""

from __future__ import annotations

import io
import itertools
import math

import pytest

from contid.errors import ContidError
from contid_paths.shapes import Shape, ShapePath
from contid_paths.table import PathRobot, write_path

CLOSED = [Shape.LINE, Shape.CIRCLE, Shape.ELLIPSE, Shape.SQUARE, Shape.BOX, Shape.CORNERS]
OPEN = [Shape.SPIRAL, Shape.TRAVERSE, Shape.DIAGONAL]


@pytest.mark.parametrize("shape", CLOSED)
def test_closed_shapes_close_exactly_after_every_lap(shape: Shape) -> None:
    path = ShapePath(shape, (50.0, 70.0), 40.0, height_mm=100.0, dz_mm=10.0, period_s=3.0, laps=3)
    assert path.point_mm(0.0) == path.point_mm(3.0) == path.point_mm(9.0) == path.point_mm(100.0)


@pytest.mark.parametrize("shape", OPEN)
def test_open_shapes_return_on_the_same_path(shape: Shape) -> None:
    path = ShapePath(shape, (0.0, 0.0), 40.0, dz_mm=10.0, period_s=2.0, laps=2)
    assert path.point_mm(0.0) != path.point_mm(2.0)
    for time_s in (0.0, 0.25, 0.75, 1.5):
        assert path.point_mm(time_s) == pytest.approx(path.point_mm(4.0 - time_s), abs=1e-12)


@pytest.mark.parametrize("shape", list(Shape))
def test_shapes_are_continuous_and_stay_in_their_size(shape: Shape) -> None:
    path = ShapePath(shape, (5.0, -3.0), 40.0, height_mm=100.0, dz_mm=10.0, laps=2, period_s=4.0)
    step = 8.0 / 4000
    points = [path.point_mm(i * step) for i in range(4001)]
    assert max(math.dist(a, b) for a, b in itertools.pairwise(points)) < 0.6
    assert max(max(abs(x - 5.0), abs(y + 3.0)) for x, y, _ in points) <= 20.0 + 1e-12
    assert all(100.0 <= z <= 110.0 for _, _, z in points)


def test_a_circle_is_round_and_a_square_has_its_corners() -> None:
    circle = ShapePath(Shape.CIRCLE, (50.0, 70.0), 40.0)
    assert all(math.dist(circle.point_mm(t / 10)[:2], (50.0, 70.0)) == pytest.approx(20.0) for t in range(40))
    square = ShapePath(Shape.SQUARE, (0.0, 0.0), 30.0)
    assert [square.point_mm(t)[:2] for t in range(4)] == [(15, -15), (15, 15), (-15, 15), (-15, -15)]
    ellipse = ShapePath(Shape.ELLIPSE, (0.0, 0.0), 30.0)
    assert ellipse.point_mm(1.0)[1] == pytest.approx(10.0)


def test_the_paths_of_the_tri_rack_paper() -> None:
    corners = ShapePath(Shape.CORNERS, (0.0, 0.0), 240.0, height_mm=300.0)
    expected = [(120, 120, 300), (-120, 120, 300), (-120, -120, 300), (120, -120, 300)]
    assert [corners.point_mm(t) for t in range(4)] == expected
    # From rest to rest: almost no way in the first hundredth of an edge.
    assert math.dist(corners.point_mm(0.01), corners.point_mm(0.0)) < 0.01
    diagonal = ShapePath(Shape.DIAGONAL, (0.0, 0.0), 240.0, height_mm=250.0, dz_mm=100.0)
    assert diagonal.point_mm(0.0) == (-120, -120, 250)
    assert diagonal.point_mm(4.0) == (120, 120, 350)
    traverse = ShapePath(Shape.TRAVERSE, (0.0, 0.0), 300.0, height_mm=300.0)
    assert (traverse.point_mm(0.0), traverse.point_mm(4.0)) == ((-150, 0, 300), (150, 0, 300))


def test_a_line_turned_by_a_quarter_is_the_line_of_the_finger_paper() -> None:
    line = ShapePath(Shape.LINE, (50.0, 60.0), 80.0, angle_deg=90.0)
    assert line.point_mm(0.0) == (50.0, 100.0, 0.0)
    assert line.point_mm(2.0) == (50.0, 20.0, 0.0)


def test_leaning_tilts_outward_by_the_angle() -> None:
    path = ShapePath(Shape.SPIRAL, (0.0, 0.0), 60.0, height_mm=120.0, lean_deg=30.0)
    for time_s in (0.5, 1.7, 4.0):
        x, y, _ = path.point_mm(time_s)
        ax, ay, az = path.direction(time_s)
        assert math.hypot(ax, ay, az) == pytest.approx(1.0)
        assert az == pytest.approx(math.cos(math.radians(30.0)))
        assert (ax * x + ay * y) / math.hypot(x, y) == pytest.approx(math.sin(math.radians(30.0)))
    with pytest.raises(ContidError, match="cannot lean"):
        ShapePath(Shape.LINE, (0.0, 0.0), 60.0, lean_deg=30.0)


@pytest.mark.parametrize(("rate", "period", "rows"), [(200.0, 4.0, 801), (3.0, 0.1, 2), (50.0, 0.3, 16)])
def test_times_are_whole_ticks(rate: float, period: float, rows: int) -> None:
    times = list(ShapePath(Shape.CIRCLE, (0.0, 0.0), 1.0, period_s=period, rate_hz=rate).times())
    assert times == [tick / rate for tick in range(rows)]


@pytest.mark.parametrize(
    "wrong", [{"size_mm": 0.0}, {"period_s": -1.0}, {"rate_hz": math.inf}, {"laps": 0.0}]
)
def test_numbers_without_meaning_are_refused(wrong: dict[str, float]) -> None:
    numbers = {"size_mm": 1.0, **wrong}
    with pytest.raises(ContidError, match="greater than 0"):
        ShapePath(Shape.CIRCLE, (0.0, 0.0), **numbers)


def test_written_numbers_read_back_to_the_same_bits() -> None:
    path = ShapePath(Shape.CIRCLE, (50.0, 70.0), 40.0, rate_hz=37.0)
    stream = io.StringIO()
    write_path(stream, path, [PathRobot("left.", 2), PathRobot("right.", 2)])
    header, *rows = stream.getvalue().splitlines()
    assert header == "t_s,left.x_mm,left.y_mm,right.x_mm,right.y_mm"
    for row, time_s in zip(rows, path.times(), strict=True):
        point = path.point_mm(time_s)[:2]
        assert tuple(map(float, row.split(","))) == (time_s, *point, *point)
