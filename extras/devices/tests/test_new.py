"""``contid new``: a copy that differs in name, port and ids only, never over another file."""

from __future__ import annotations

import difflib
import errno
import os
import pty
import select
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from contid.errors import ContidError
from contid.robot_file.load import load_robot_file
from contid_devices import new_file
from contid_devices.new_file import shipped_templates
from tests.support.command import contid_in

pytestmark = pytest.mark.process


def contid(words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    done = contid_in(folder, *words.split())
    assert "Traceback" not in done.stderr
    return done


def test_only_name_port_and_ids_change(tmp_path: Path, configs: Path) -> None:
    done = contid("new mine --from hand --port /dev/ttyUSB7 --ids 11,12,13,14", tmp_path)
    assert done.returncode == 0, done.stderr
    old, new = (configs / "hand.yaml").read_text(), (tmp_path / "mine.yaml").read_text()
    changed = [
        line[2:].strip()
        for line in difflib.ndiff(old.splitlines(), new.splitlines())
        if line.startswith("+ ")
    ]
    assert [line.split(", mm_per_rev")[0] for line in changed] == [
        "name: mine",
        "port: /dev/ttyUSB7",
        "left: {bus: servos, id: 11",
        "right: {bus: servos, id: 12",
        "left: {bus: servos, id: 13",
        "right: {bus: servos, id: 14",
    ]
    checked = contid("check mine.yaml", tmp_path)
    assert (checked.returncode, checked.stdout.startswith("mine: 2 robots")) == (0, True)


def test_a_file_system_without_links_is_written_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As FAT and exFAT; what another program has made in the meantime stays."""

    def link(*arguments: object, **named: object) -> None:
        raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))

    monkeypatch.setattr(os, "link", link)
    template, path = new_file.read_template("hand"), tmp_path / "mine.yaml"
    assert new_file.write_copy(template, path, {}, {}).file.name == "mine"
    path.write_text("another's")
    with pytest.raises(ContidError, match="exists already; nothing was written"):
        new_file.write_copy(template, path, {}, {})
    assert path.read_text() == "another's"
    assert [*tmp_path.iterdir()] == [path]


@pytest.mark.parametrize("name", ["123", "null", "1e3", ".5", "yes"])
def test_a_name_that_yaml_takes_for_something_else_is_a_text(name: str, tmp_path: Path) -> None:
    from contid_devices.new_file import file_of, read_template, write_copy

    path = file_of(str(tmp_path / f"{name}.yaml"))
    assert write_copy(read_template("hand"), path, {}, {"left.left": 7}).file.name == name


@pytest.mark.parametrize("name", shipped_templates())
def test_every_shipped_file_can_be_copied(name: str, tmp_path: Path, configs: Path) -> None:
    from contid_devices.new_file import file_of, read_template, write_copy

    template, path = read_template(name), file_of(str(tmp_path / "a robot: mine #2"))
    ports = {bus: f"/dev/{bus} #1" for bus in template.ports}
    write_copy(template, path, ports, {})
    data, before = (yaml.safe_load(file.read_text()) for file in (path, configs / f"{name}.yaml"))
    assert (data.pop("name"), before.pop("name")) == ("a robot: mine #2", name)
    assert {bus: keys.pop("port") for bus, keys in data["buses"].items()} == ports
    for keys in before["buses"].values():
        del keys["port"]
    assert data == before
    assert load_robot_file(path).file.name == "a robot: mine #2"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("new finger --from hand", "finger: is the name of a shipped robot file"),
        ("new mine --from fingr", "did you mean 'finger'?"),
        ("new there --from finger", "there.yaml: exists already; nothing was written"),
        ("new no/where --from finger", "no/where.yaml: there is no folder no"),
        ("new mine --from finger --ids 1", "1 given, 2 needed: finger.left, finger.right."),
        ("new mine --from finger --ids 1,x", "'1,x': whole numbers separated by commas."),
        ("new mine --from finger --ids 7,7", "mine.yaml:46:"),
        ("new mine --from trirack --ids 1,2,3", "have channels, not ids"),
        ("new mine --from cbha --port /dev/x", "give BUS=PORT for each"),
        ("new mine --from cbha --port tub=/dev/x", "no bus 'tub'"),
    ],
)
def test_mistakes_write_nothing(words: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "there.yaml").write_text("mine\n")
    done = contid(words, tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["there.yaml"]
    assert (tmp_path / "there.yaml").read_text() == "mine\n"


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to become another user")
def test_a_folder_without_the_right_to_write_is_named_by_the_file(tmp_path: Path) -> None:
    template, path = new_file.read_template("finger"), tmp_path / "mine.yaml"
    for folder in (tmp_path, *tmp_path.parents[:2]):
        folder.chmod(0o755)
    os.seteuid(54321)
    try:
        with pytest.raises(ContidError, match=f"{path}: cannot be written: Permission denied"):
            new_file.write_copy(template, path, {}, {})
    finally:
        os.seteuid(0)
    assert not list(tmp_path.iterdir())


def test_a_terminal_is_asked_for_port_and_ids(tmp_path: Path) -> None:
    own, other = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "contid", "new", "mine", "--from", "finger"],
        cwd=tmp_path,
        stdin=other,
        stdout=other,
        stderr=other,
        close_fds=True,
    )
    os.close(other)
    shown = ""
    for question, answer in (
        ("port of bus servos", "/dev/ttyACM9"),
        ("id of axis finger.left", "21"),
        ("id of axis finger.right", ""),
    ):
        while not (question in shown and shown.rstrip().endswith(":")):
            assert select.select([own], [], [], 60)[0], shown
            shown += os.read(own, 4096).decode()
        os.write(own, f"{answer}\n".encode())
        shown = shown.partition(question)[2].partition(":")[2]
        shown = "" if question in shown else shown
    assert process.wait(60) == 0
    os.close(own)
    data = yaml.safe_load((tmp_path / "mine.yaml").read_text())
    assert data["buses"]["servos"]["port"] == "/dev/ttyACM9"
    assert [axis["id"] for axis in data["robots"]["finger"]["axes"].values()] == [21, 2]
