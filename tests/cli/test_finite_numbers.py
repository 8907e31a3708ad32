"""No option of any command takes "nan" for a number: comparisons with it are false, so bounds let it pass."""

from __future__ import annotations

import click

from contid.cli.main import cli
from contid.cli.support.parameters import Number
from tests.cli.every_option import parameters


def test_numbers_of_all_commands_are_finite() -> None:
    numbers = {
        (command, each.name): each.type
        for command, each in parameters(cli, ("contid",))
        if isinstance(each.type, (click.types.FloatParamType, click.FloatRange))
    }
    assert len(numbers) > 20
    assert not [place for place, kind in numbers.items() if not isinstance(kind, Number)]
