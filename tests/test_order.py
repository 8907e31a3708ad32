"""The order in which workers get files."""

from __future__ import annotations

from pathlib import Path

from tests.support.plugins.order import LONGEST, SHARING, in_order, sharers

ROOT = Path(__file__).parent.parent


def test_the_longest_files_exist_and_are_named_once() -> None:
    assert [file for file in LONGEST if not (ROOT / file).is_file()] == []
    assert len(set(LONGEST)) == len(LONGEST)


def test_long_files_come_first_then_those_with_most_tests() -> None:
    files = ["tests/b.py", *["tests/a.py"] * 2, LONGEST[1], "tests/c.py", LONGEST[0]]
    assert sorted(set(files), key=in_order(files).__getitem__) == [
        *LONGEST[:2], "tests/a.py", "tests/b.py", "tests/c.py"
    ]  # fmt: skip


def test_files_that_share_a_browser_go_to_few_workers() -> None:
    assert sharers("tests/test_order.py") == "tests/test_order.py"
    for folder, workers in SHARING.items():
        files = [str(path.relative_to(ROOT)) for path in (ROOT / folder).glob("test_*.py")]
        assert len({sharers(file) for file in files}) == workers < len(files)
