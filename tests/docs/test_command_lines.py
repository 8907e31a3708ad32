"""Every ``contid`` command printed in README and docs is one that this version has, with its options.

Blocks marked ``sh`` run whole (`test_examples`). The others need hardware, a second machine, a person or
minutes; here their command lines are parsed, and not run.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from contid.cli.main import cli

ROOT = Path(__file__).parent.parent.parent
PAGES = ("README.md", *sorted(str(page.relative_to(ROOT)) for page in (ROOT / "docs").rglob("*.md")))
#: What separates the commands of one line.
_BETWEEN = {"|", "||", "&&", "&", ";"}


def commands(text: str) -> Iterator[list[str]]:
    """The arguments of every contid command in the fenced blocks of a page."""
    for language, block in re.findall(r"^```(\w*)\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        if language not in ("", "sh", "bash", "console"):
            continue
        for line in block.replace("\\\n", " ").splitlines():
            if not re.match(r"(\$ )?(\S*/)?contid |.*[|&] *(\S*/)?contid ", line):
                continue
            words = shlex.shlex(line.removeprefix("$ "), posix=True, punctuation_chars=True)
            words.whitespace_split, words.commenters = True, "#"
            yield from _split(list(words))


def _split(words: list[str]) -> Iterator[list[str]]:
    here: list[str] = []
    for word in [*words, ";"]:
        if word in _BETWEEN:
            if here and Path(here[0]).name == "contid":
                yield here[1:]
            here = []
        else:
            here.append(word)


def parse(arguments: list[str]) -> None:
    """Parse a command line down to its last subcommand, without running it or looking at files."""
    for number, word in enumerate(arguments):
        if word in ("<", ">", ">>"):
            arguments = arguments[:number]
            break
    group: click.Group = cli
    names = ["contid"]
    while True:
        context = click.Context(group, info_name=names[-1])
        if not arguments or arguments[0] in ("--version", "--help", "-h"):
            return
        name, *arguments = arguments
        found = group.get_command(context, name)
        assert found is not None, f"{' '.join(names)} has no command {name!r}"
        names.append(name)
        if not isinstance(found, click.Group):
            parser = found.make_parser(click.Context(found, info_name=name))
            parser.parse_args(args=arguments)
            return
        group = found


@pytest.mark.parametrize("page", [page for page in PAGES if list(commands((ROOT / page).read_text()))])
def test_printed_commands_exist(page: str) -> None:
    for arguments in commands((ROOT / page).read_text()):
        try:
            parse(list(arguments))
        except click.UsageError as error:
            pytest.fail(f"{page}: contid {shlex.join(arguments)}: {error.format_message()}")


@pytest.mark.parametrize(
    ("line", "message"),
    [("contid runn hand", "has no command 'runn'"), ("contid run hand --vitual", "No such option")],
)
def test_a_stale_command_is_found(line: str, message: str) -> None:
    (found,) = commands(f"```\n{line}  # why\n```\n")
    with pytest.raises((AssertionError, click.UsageError), match=message):
        parse(found)
