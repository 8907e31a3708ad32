"""Figures of spatial arms: silhouettes with the area of the body they are made of."""

from __future__ import annotations

import errno
import itertools
import os
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from shapely import box

from contid.errors import ContidError
from contid_reach.planar import area_cm2, overlapping
from contid_reach.plot import save_plot, silhouette, volume_text
from contid_reach.report import ReachReport, with_unit
from contid_reach.spatial import Volume


@pytest.fixture(scope="module", autouse=True)
def fonts() -> None:
    """Matplotlib never closes its font files; open them before descriptors are counted."""
    figure = Figure()
    figure.text(0.0, 0.0, "x³")
    figure.savefig(BytesIO())


def ball(radius: int) -> frozenset[tuple[int, int, int]]:
    steps = range(-radius, radius + 1)
    return frozenset(
        (x, y, z) for x, y, z in itertools.product(steps, repeat=3) if x * x + y * y + z * z <= radius**2
    )


def test_the_silhouette_of_a_ball_is_a_disc_with_a_smooth_edge() -> None:
    """Its contour at one half, by matplotlib, has the area and the circumference of the disc."""
    x, y, inside = silhouette(ball(20), 0, 2)
    contour = Figure().subplots().contour(x, y, inside, levels=[0.5])
    (line,) = contour.allsegs[0]
    along = np.diff(line, axis=0)
    area = 0.5 * abs(np.sum(line[:-1, 0] * line[1:, 1] - line[1:, 0] * line[:-1, 1]))
    assert area == pytest.approx(np.pi * 20.0**2, rel=0.02)
    # Steps of voxels would make it 4/pi times as long.
    assert np.hypot(*along.T).sum() == pytest.approx(2.0 * np.pi * 20.0, rel=0.06)


def test_a_straight_edge_stays_where_it_is() -> None:
    x, y, inside = silhouette({(i, 0, k) for i in range(10) for k in range(30)}, 0, 2)
    row = inside[list(y).index(15)]
    left = np.interp(0.5, row[: len(row) // 2], x[: len(row) // 2])
    assert left == pytest.approx(-0.5, abs=0.01)


@pytest.mark.parametrize(
    ("cm3", "text"), [(12.345, "12.3 cm³"), (999.0, "999 cm³"), (25432.0, "25.4 litres")]
)
def test_volumes_are_in_readable_units(cm3: float, text: str) -> None:
    assert volume_text(cm3) == text


def test_the_legend_is_beside_the_plot(tmp_path: Path) -> None:
    """Below the panes: rows of pixels under the axes have the colour of the arm, and no pane covers them."""
    volume = Volume(dict.fromkeys(ball(12), ()), 0.01, 10)
    report = ReachReport(volumes={"arm": volume}, volumes_cm3={"arm": volume.volume_m3 * 1e6})
    save_plot(report, tmp_path / "arm.png", "arm")
    pixels = np.asarray(Image.open(tmp_path / "arm.png").convert("RGB")).astype(int)
    blue = (pixels[..., 2] - pixels[..., 0]) > 40
    rows = np.flatnonzero(blue.any(axis=1))
    gaps = np.flatnonzero(np.diff(rows) > 20)
    assert len(gaps) >= 1  # between the panes and the legend
    assert rows[-1] > 0.9 * len(pixels)


@pytest.mark.parametrize("planar", [True, False])
def test_more_robots_than_colours_are_drawn_too(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, planar: bool
) -> None:
    """From the sixth on robots were left out without a word; the fifth and sixth overlap by 2 cm²."""
    shown: list[str] = []
    monkeypatch.setattr(Figure, "legend", lambda self, **keys: shown.extend(_labels(self)))
    regions = {f"r{k}": box(0.1 * k, 0.0, 0.1 * k + (0.12 if k == 4 else 0.08), 0.1) for k in range(6)}
    volume = Volume(dict.fromkeys(ball(3), ()), 0.01, 10)
    report = (
        ReachReport(
            regions=regions,
            areas_cm2={name: area_cm2(region) for name, region in regions.items()},
            overlaps={pair: area_cm2(region) for pair, region in overlapping(regions).items()},
        )
        if planar
        else ReachReport(
            volumes=dict.fromkeys(regions, volume), volumes_cm3=dict.fromkeys(regions, volume.volume_m3 * 1e6)
        )
    )
    save_plot(report, tmp_path / "six.png", "six")
    assert [label.partition(":")[0] for label in shown] == [*regions] + ["r4 and r5"] * planar


def test_a_disk_that_gets_full_leaves_the_figure_that_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was cut to nothing, and the message did not name it."""
    path = tmp_path / "reach.svg"
    path.write_text("the figure that was there")

    def fail(*arguments: object, **keys: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("contid.whole_file.os.fsync", fail)
    with pytest.raises(ContidError, match=r"reach\.svg: cannot write it: No space left on device"):
        save_plot(
            ReachReport(regions={"one": box(0.0, 0.0, 0.1, 0.1)}, areas_cm2={"one": 100.0}), path, "one"
        )
    assert path.read_text() == "the figure that was there"


def _labels(figure: Figure) -> list[str]:
    return [label for axes in figure.axes for label in axes.get_legend_handles_labels()[1]]


def test_a_volume_is_printed_with_its_uncertainty() -> None:
    assert with_unit(0.2649, 0.032) == "264.9 +- 32.0 litres"
    assert with_unit(81.4e-6, 6e-6) == "81 +- 6 cm3"
