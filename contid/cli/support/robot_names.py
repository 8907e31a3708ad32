"""Shell completion of robot files: the shipped names, and files."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import click
    from click.shell_completion import CompletionItem


def robot_names(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Shipped names with this beginning; the shell adds the files."""
    from click.shell_completion import CompletionItem

    from contid.robot_file.load import configs_folder

    names = sorted(file.stem for file in configs_folder().glob("*.yaml"))
    shipped = [CompletionItem(name) for name in names if name.startswith(incomplete)]
    return [*shipped, CompletionItem(incomplete, type="file")]
