"""The parameters of all commands."""

from __future__ import annotations

from collections.abc import Iterator

import click


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
