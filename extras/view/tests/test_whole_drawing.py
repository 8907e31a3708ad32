"""Drawings are whole or not there; what `contid view` cannot do is refused, without a viewer."""

from __future__ import annotations

import os
from http import HTTPStatus
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from contid_view.command import command
from contid_view.csp_proxy import MAX_BODY_BYTES, _RefusedError, _Request
from contid_view.view_target import ViewError
from contid_view.whole_drawing import whole_drawing


def half_drawn(path: Path, error: BaseException) -> None:
    with whole_drawing(path) as part:
        assert part == part_of(path)
        part.write_text("half")
        raise error


def part_of(path: Path) -> Path:
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")


def test_a_drawing_that_breaks_off_leaves_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    path.write_text("old")
    with pytest.raises(ViewError, match=r"^[^.]*/run\.rrd: cannot write it whole$"):
        half_drawn(path, ViewError(f"{part_of(path)}: cannot write it whole"))
    with pytest.raises(KeyboardInterrupt):
        half_drawn(path, KeyboardInterrupt())
    assert path.read_text() == "old"
    with whole_drawing(path) as part:
        part.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert [*tmp_path.iterdir()] == [path]


def test_a_link_stays_one_and_a_device_is_written_directly(tmp_path: Path) -> None:
    path, device = tmp_path / "link.rrd", tmp_path / "null.rrd"
    path.symlink_to(tmp_path / "run.rrd")
    device.symlink_to("/dev/null")
    with whole_drawing(path) as part:
        part.write_text("new")
    assert path.is_symlink()
    assert (tmp_path / "run.rrd").read_text() == "new"
    with whole_drawing(device) as part:
        assert part == device


def test_a_robot_file_for_a_finished_drawing_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    path.touch()
    done = CliRunner().invoke(command, [str(path), "--serve", "--robot", "hand"])
    assert done.exit_code == click.UsageError.exit_code
    assert "--robot is for sessions" in done.output


@pytest.mark.parametrize("length", [str(MAX_BODY_BYTES + 1), "9" * 5000])
def test_a_body_that_is_too_long_is_refused_by_its_length(length: str) -> None:
    with pytest.raises(_RefusedError) as refused:
        _Request("POST", "/", {"content-length": length}).body_bytes
    assert refused.value.status == HTTPStatus.REQUEST_ENTITY_TOO_LARGE
    assert _Request("POST", "/", {"content-length": "0" * 5000 + "7"}).body_bytes == 7
