"""What a shell is offered for an unfinished command line."""

from __future__ import annotations

import re

import click
import pytest
from click.shell_completion import ShellComplete
from click.testing import CliRunner

from contid.cli.main import COMMANDS, SECTIONS, cli


def offered(*message: str) -> list[tuple[str, str]]:
    *before, incomplete = message
    found = ShellComplete(cli, {}, "contid", "_CONTID_COMPLETE").get_completions(list(before), incomplete)
    return [(item.value, item.type) for item in found]


@pytest.mark.parametrize(
    "message", [["run"], ["check"], ["ik"], ["emulate", "due"], ["path", "circle", "--for"]]
)
def test_robot_files_are_shipped_names_and_files(message: list[str]) -> None:
    assert offered(*message, "trirack2") == [
        ("trirack2", "plain"),
        ("trirack2.emulated", "plain"),
        ("trirack2", "file"),
    ]


def test_commands_and_options() -> None:
    assert ("resume", "plain") in offered("re")
    assert offered("run", "--un") == [("--unreachable", "plain")]


def test_an_unknown_command_is_answered_with_the_nearest_one() -> None:
    answer = CliRunner().invoke(cli, ["rnu"])
    assert answer.exit_code == 2
    assert "No such command 'rnu'. Did you mean 'run'?" in answer.output


def test_every_command_is_in_one_section_of_the_help() -> None:
    placed = [name for names in SECTIONS.values() for name in names]
    existing = cli.list_commands(click.Context(cli))
    assert len(placed) == len(set(placed))
    assert set(COMMANDS) <= set(placed) <= set(existing)
    answer = CliRunner().invoke(cli, ["--help"])
    listed = re.findall(r"^  ([a-z][a-z-]*) ", answer.output, re.MULTILINE)
    assert sorted(listed) == sorted(existing)
    assert all(f"\n{heading}:\n" in answer.output for heading in (*SECTIONS, "Commands of extras"))
