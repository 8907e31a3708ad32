"""``contid schema``: the JSON Schema of the robot file, and the page made from it."""

from __future__ import annotations

import json

import click


@click.command()
@click.option("--markdown", is_flag=True, help="The same as a page to read: docs/robot-file.md.")
def command(markdown: bool) -> None:
    """Print the JSON Schema (draft 2020-12) of the robot file, for editors.

    In VS Code with the YAML extension, write the output to a file and begin the robot file with
    "# yaml-language-server: $schema=FILE".
    """
    if markdown:
        from contid_manual.robot_file_page import robot_file_page

        click.echo(robot_file_page(), nl=False)
        return
    from contid_manual.schema import robot_file_schema

    click.echo(json.dumps(robot_file_schema(), indent=2))
