"""The output files of every command: ``-`` is standard output or refused, never a file of that name."""

from __future__ import annotations

import click

from contid.cli.main import cli
from contid.cli.support.parameters import NewFile
from tests.cli.every_option import parameters


def test_a_dash_becomes_no_file() -> None:
    outputs = {
        (command, each.name): each.type
        for command, each in parameters(cli, ("contid",))
        if isinstance(each.type, click.Path) and {"-o", "--output"} & {*each.opts}
    }
    assert len(outputs) > 6
    assert not [
        place for place, kind in outputs.items() if not (isinstance(kind, NewFile) or kind.allow_dash)
    ]
