"""Files of machines and operators: every mistake with its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from contid.errors import ContidError
from contid_fleet.fleet_file import MachineFile, load_operator_file

LOCAL = "fleet: lab\nlisten: [tcp/127.0.0.1:7447]\n"


def refusal(tmp_path: Path, text: str) -> str:
    path = tmp_path / "machine.yaml"
    path.write_text(text)
    with pytest.raises(ContidError) as error:
        MachineFile.load(path)
    return str(error.value)


@pytest.mark.parametrize(
    ("text", "place", "why"),
    [
        ("fleet: lab\nlisten: [tcp/192.168.1.10:7447]\n", ":2:", "without TLS"),
        ("fleet: lab\n", ":1:", "endpoint"),
        (LOCAL + "operators: {anna: [watch, drive]}\n", ":3:", "drive"),
        (LOCAL + "operators: {anna: [watch, move]}\n", ":1:", "not verified"),
        (LOCAL + "nodes: {who: /run/s}\n", ":3:", "who"),
        (LOCAL + "nodes: {'hand*': /run/s}\n", ":3:", "hand"),
        (LOCAL + "operator: {anna: [watch]}\n", ":3:", "operators"),
        (LOCAL + "telemetry_hz: 500\n", ":3:", "200"),
    ],
)
def test_a_mistake_is_named_with_its_line(tmp_path: Path, text: str, place: str, why: str) -> None:
    message = refusal(tmp_path, text)
    assert f"machine.yaml{place}" in message
    assert why in message


def test_without_tls_rights_beyond_watching_need_a_decision(tmp_path: Path) -> None:
    path = tmp_path / "machine.yaml"
    path.write_text(LOCAL + "operators: {anna: [watch]}\n")
    assert MachineFile.load(path).operators["anna"] == ["watch"]
    path.write_text(LOCAL + "operators: {anna: [move]}\ntrust_local_users: true\n")
    assert MachineFile.load(path).operators["anna"] == ["move"]


def test_an_operator_needs_an_endpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "anna.yaml"
    path.write_text("fleet: lab\noperator: anna\n")
    with pytest.raises(ContidError, match="connect"):
        load_operator_file(path)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ContidError, match="--file"):
        load_operator_file(None)
