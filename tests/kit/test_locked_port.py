"""A port of contid is exclusive; a pseudo terminal is not: its emulator outlives a killed owner."""

from __future__ import annotations

import fcntl
import os
import struct

import pytest

from contid.kit.locked_port import lock_port, unlock_port

TIOCGEXCL = 0x80045440


def banned(descriptor: int) -> bool:
    return struct.unpack("i", fcntl.ioctl(descriptor, TIOCGEXCL, bytes(4))) == (1,)


@pytest.mark.parametrize(("called", "kept"), [("/dev/ttyUSB0", True), ("", False)])
def test_others_are_kept_out_while_it_is_open(called: str, kept: bool) -> None:
    master, slave = os.openpty()
    try:
        lock_port(slave, called or os.ttyname(slave))
        assert banned(slave) == kept
        unlock_port(slave)
        assert not banned(slave)
    finally:
        os.close(master)
        os.close(slave)
    unlock_port(-1)  # a port that died
