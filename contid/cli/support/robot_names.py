"""What a shell completes where a command takes a robot file: the names of shipped ones, and files."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import click
    from click.shell_completion import CompletionItem


def robot_names(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Shipped names that begin so; the shell adds the files."""
    from click.shell_completion import CompletionItem

    from contid.robot_file.shipped import configs_folder

    names = sorted(file.stem for file in configs_folder().glob("*.yaml"))
    shipped = [CompletionItem(name) for name in names if name.startswith(incomplete)]
    return [*shipped, CompletionItem(incomplete, type="file")]
