"""Keys from the bytes of terminals, however they are cut; a terminal gets its settings back."""

from __future__ import annotations

import os
import termios

from hypothesis import given
from hypothesis import strategies as st

from contid_hands.teleop.keys import Keyboard, KeyDecoder

KEYS = {
    b"a": "a", b"\x1b[A": "up", b"\x1bOB": "down", b"\x1b[C": "right", b"\x1b[1;5D": "unknown", b" ": "space",
    b"\r": "enter", b"\x7f": "backspace", "é".encode(): "é", b"\x1b[5~": "pageup",
}  # fmt: skip


@given(st.lists(st.sampled_from(sorted(KEYS)), max_size=12), st.data())
def test_cuts_do_not_matter(pressed: list[bytes], data: st.DataObject) -> None:
    wire = b"".join(pressed)
    cuts = sorted(data.draw(st.sets(st.integers(1, max(len(wire) - 1, 1)), max_size=6)))
    decoder, keys = KeyDecoder(), []
    for begin, end in zip([0, *cuts], [*cuts, len(wire)], strict=True):
        if wire[begin:end]:
            keys += decoder.feed(wire[begin:end])
    assert keys == [KEYS[each] for each in pressed]


def test_an_escape_that_nothing_follows_is_a_key() -> None:
    decoder = KeyDecoder()
    assert decoder.feed(b"\x1b") == []
    assert decoder.feed(b"") == ["escape"]
    assert decoder.feed(b"\x1b\x1b[A") == ["escape", "up"]


def test_a_terminal_is_restored_and_its_end_is_the_end() -> None:
    master, slave = os.openpty()
    before = termios.tcgetattr(slave)
    with Keyboard(slave) as keyboard:
        assert keyboard.interactive
        assert termios.tcgetattr(slave) != before
        os.write(master, b"\x1b[Ax")
        assert keyboard.keys(5.0) == ["up", "x"]
        assert keyboard.keys() == []
    assert termios.tcgetattr(slave) == before
    os.close(master)
    os.close(slave)


def test_the_end_of_a_pipe_is_the_end() -> None:
    read, write = os.pipe()
    os.write(write, b"s\n")
    os.close(write)
    with Keyboard(read) as keyboard:
        assert keyboard.keys(5.0) == ["s", "enter"]
        assert keyboard.keys(5.0) is None
    os.close(read)
