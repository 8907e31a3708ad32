"""No option of any command takes "nan" for a number: comparisons with it are false, so bounds let it pass."""

from __future__ import annotations

from collections.abc import Iterator

import click

from contid.cli.main import cli
from contid.cli.support.parameters import Number


def parameters(group: click.Group, names: tuple[str, ...]) -> Iterator[tuple[str, click.Parameter]]:
    """Of all commands below a group, with their names."""
    context = click.Context(group, info_name=names[-1])
    for name in group.list_commands(context):
        found = group.get_command(context, name)
        assert found is not None
        if isinstance(found, click.Group):
            yield from parameters(found, (*names, name))
        else:
            yield from ((" ".join((*names, name)), each) for each in found.params)


def test_numbers_of_all_commands_are_finite() -> None:
    numbers = {
        (command, each.name): each.type
        for command, each in parameters(cli, ("contid",))
        if isinstance(each.type, (click.types.FloatParamType, click.FloatRange))
    }
    assert len(numbers) > 20
    assert not [place for place, kind in numbers.items() if not isinstance(kind, Number)]
