"""A port of contid is nobody else's; a pseudo terminal stays free: its emulator outlives a killed owner."""

from __future__ import annotations

import fcntl
import os
import struct

import pytest

from contid_drivers.exclusive import keep_others_out, let_others_in

TIOCGEXCL = 0x80045440


def banned(descriptor: int) -> bool:
    return struct.unpack("i", fcntl.ioctl(descriptor, TIOCGEXCL, bytes(4))) == (1,)


@pytest.mark.parametrize(("called", "kept"), [("/dev/ttyUSB0", True), ("", False)])
def test_others_are_kept_out_while_it_is_open(called: str, kept: bool) -> None:
    master, slave = os.openpty()
    try:
        keep_others_out(slave, called or os.ttyname(slave))
        assert banned(slave) == kept
        let_others_in(slave)
        assert not banned(slave)
    finally:
        os.close(master)
        os.close(slave)
    let_others_in(-1)  # a port that died
