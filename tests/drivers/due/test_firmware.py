"""Cache of the emulator program, and the errors without a place for it."""

from __future__ import annotations

import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from click.testing import CliRunner

from contid.errors import DeviceError
from contid_devices.due.firmware_build import (
    build_host,
    build_id,
    build_note,
    build_once,
    cache_dir,
    firmware_dir,
)
from contid_devices.firmware import command as firmware_command
from contid_drivers.due import messages
from contid_drivers.due.codes import PROTOCOL_VERSION


def test_without_a_home_folder_the_message_names_the_variable_to_set(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", unknown)
    with pytest.raises(DeviceError, match="set XDG_CACHE_HOME"):
        cache_dir()


def test_a_cache_that_cannot_be_made_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(DeviceError, match=r"file/contid/firmware: Not a directory.*XDG_CACHE_HOME"):
        build_host()


@pytest.mark.parametrize(
    ("version", "answer"),
    [
        (1, "01ff0701020100"),  # refused, wrong version
        (2, "02ff0701020200"),
        (
            2,
            "028107000601010000000000e0e1e2e3e4e5e6e7e8e9eaebecedeeef0100001d07b001000000000000000c0c0c0c0c0c656d",
        ),
    ],
)
def test_a_board_of_an_older_protocol_is_refused_with_a_message(version: int, answer: str) -> None:
    with pytest.raises(
        messages.BadAnswerError, match=f"protocol version {version}, this contid {PROTOCOL_VERSION}"
    ):
        messages.read_answer(bytes.fromhex(answer))


def test_a_board_shows_which_sources_it_was_built_from() -> None:
    flags = CliRunner().invoke(firmware_command, ["flash", "/dev/ttyACM0", "--dry-run"]).stdout
    assert f"compiler.cpp.extra_flags=-DCONTID_BUILD_ID={build_id()}u" in flags
    assert build_note(0) == "built by hand"
    assert build_note(build_id()) == "built from these sources"
    assert "contid firmware flash" in build_note(build_id() ^ 1)


def test_a_folder_is_no_binary(tmp_path: Path) -> None:
    done = CliRunner().invoke(
        firmware_command, ["flash", "/dev/ttyACM0", "--binary", str(tmp_path), "--dry-run"]
    )
    assert done.exit_code == 2
    assert "is a directory" in done.output


def test_another_source_is_another_build(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copied = tmp_path / "firmware"
    shutil.copytree(firmware_dir() / "contid_due", copied / "contid_due")
    before = build_id()
    monkeypatch.setenv("CONTID_FIRMWARE", str(copied))
    assert build_id() == before
    with (copied / "contid_due" / "src" / "due" / "pins.h").open("a") as file:
        file.write("// another wiring\n")
    assert build_id() != before


def test_a_named_folder_without_sources_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CONTID_FIRMWARE", str(tmp_path))
    with pytest.raises(DeviceError, match=rf"no sources in {tmp_path} \(CONTID_FIRMWARE: "):
        firmware_dir()


@pytest.mark.process
def test_of_two_builders_at_once_one_compiles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    compiler = tmp_path / "compiler"
    compiler.write_text(f'#!/bin/sh\necho built >> {tmp_path}/log\nsleep 0.2\ntouch "$2"\n')
    compiler.chmod(0o755)
    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(lambda _: build_once("x", [str(compiler)], [compiler], []), range(2))
    assert first == second
    assert first.is_file()
    assert (tmp_path / "log").read_text() == "built\n"


@pytest.mark.campaign
@pytest.mark.process
def test_a_core_that_does_not_compile_for_the_board_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copied = tmp_path / "firmware"
    shutil.copytree(firmware_dir(), copied)
    with (copied / "contid_due" / "src" / "core" / "crc16.cpp").open("a") as file:
        file.write("#ifdef __arm__\n#error not on a board\n#endif\n")
    monkeypatch.setenv("CONTID_FIRMWARE", str(copied))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    done = CliRunner().invoke(firmware_command, ["build"])
    assert "not on a board" in str(done.exception)
    assert done.exit_code != 0
