"""Robot files made to hold a check up, or to show a person something else than what is read."""

from __future__ import annotations

import pytest

from contid.errors import MAX_FINDINGS, BadInputError, Located
from contid.robot_file.load import configs_folder, parse_robot_file
from tests.support.command import contid

MANY = 1_000


def findings(text: str) -> tuple[Located, ...]:
    with pytest.raises(BadInputError) as caught:
        parse_robot_file(text, "x.yaml")
    return caught.value.findings


@pytest.mark.slow
@pytest.mark.parametrize(
    ("head", "line"),
    [
        ("robots:", "  r{}: {{model: rack_finger}}"),
        ("robots:", "  r{}: {{}}"),
        ("robots: {}\nbuses:", "  b{}: {{driver: dynamixel}}"),
        ("", "unknown{}: 1"),
        ("robots:\n  r:\n    model: rack_finger\n    axes:", "      a{}: {{bus: b}}"),
        ("robots:\n  r:", "    key: {}"),
    ],
    ids=["incomplete robots", "empty robots", "incomplete buses", "unknown keys", "axes", "repeated keys"],
)
def test_findings_of_a_huge_wrong_file_are_capped(head: str, line: str) -> None:
    lines = "\n".join(line.format(number) for number in range(MANY))
    found = findings(f"contid: 1\nname: x\nrate_hz: 100\n{head}\n{lines}\n")
    assert len(found) == MAX_FINDINGS + 1
    assert f"the first {MAX_FINDINGS} mistakes are listed" in found[-1].message
    assert max(len(each.message) for each in found) < 10_000


def test_a_missing_bus_among_thousands_lists_some() -> None:
    buses = "\n".join(f"  b{number}: {{driver: sim}}" for number in range(2000))
    text = f"contid: 1\nname: x\nrate_hz: 100\nbuses:\n{buses}\nrobots:\n  r: {{axes: {{a: {{bus: c}}}}}}\n"
    (message,) = [each.message for each in findings(text) if "no bus 'c'" in each.message]
    assert "b49 and 1950 others" in message


@pytest.mark.parametrize("code", [0x202E, 0x2066, 0x200F, 0x061C, 0x2028, 0x200B, 0xFEFF, 0x9B])
@pytest.mark.parametrize("escaped", [True, False])
def test_invisible_characters_are_refused_with_their_place(code: int, escaped: bool) -> None:
    text = (configs_folder() / "finger.yaml").read_text(encoding="utf-8")
    line = next(number for number, each in enumerate(text.split("\n"), 1) if each.startswith("name:"))
    written = f"\\u{code:04x}" if escaped else chr(code)
    lines = text.split("\n")
    lines[line - 1] = f'name: "a{written}b"'
    found = findings("\n".join(lines))
    assert (found[0].line, len(found)) == (line, 1)
    assert f"U+{code:04X}" in found[0].message or "not text" in found[0].message
    assert found[0].message.isprintable()


def test_a_mark_in_a_comment_is_refused_and_joiners_are_allowed() -> None:
    text = (configs_folder() / "finger.yaml").read_text(encoding="utf-8")
    (found,) = findings(text + "# 10 \u202emm\u202c\n")
    assert (found.line, found.column) == (text.count("\n") + 1, 6)
    name = "\N{WOMAN}\u200d\N{MICROSCOPE} \u0645\u06cc\u200c\u062e, 10\u00a0mm"
    before = next(each for each in text.split("\n") if each.startswith("name:"))
    assert parse_robot_file(text.replace(before, f"name: {name}"), "x.yaml").file.name == name


def test_a_key_with_a_mark_is_refused_and_shown_escaped() -> None:
    found = findings('contid: 1\n"ro\\u202ebots": {"\\u001b[2J": 3}\n')
    assert [each.line for each in found[:2]] == [2, 2]
    assert all(each.message.isprintable() for each in found)


@pytest.mark.process
@pytest.mark.parametrize("command", [["check"], ["run", "--virtual"]])
def test_a_file_without_an_end_is_refused(command: list[str]) -> None:
    """It was read until the memory was gone."""
    done = contid(*command, "/dev/zero")
    assert done.returncode == 2
    assert "/dev/zero:1:1: more than 4000000 bytes" in done.stderr


@pytest.mark.parametrize("code", [0x85, 0xAD])
def test_a_comment_cannot_hide_the_end_of_its_line(code: int) -> None:
    """To the parser U+0085 ends a line: what a person sees as a comment would be a key."""
    text = (configs_folder() / "finger.yaml").read_text(encoding="utf-8")
    (found,) = findings(text + f"# see the manual{chr(code)}clearance: {{}}\n")
    assert (found.line, found.column) == (text.count("\n") + 1, 17)
    assert f"U+{code:04X}" in found.message
