"""Machines of their own: network namespaces on one switch, whose cables can be pulled; they need root."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import pytest

#: Addresses of the namespaces; they exist inside of them only.
PREFIX = "10.231.77"


def need_namespaces() -> None:
    """Skip a test where network namespaces cannot be made."""
    if shutil.which("ip") is None:
        pytest.skip("network namespaces need iproute2")
    if os.geteuid() != 0:
        pytest.skip("network namespaces need root")
    name = f"contid-{os.getpid()}-try"
    tried = subprocess.run(["ip", "netns", "add", name], capture_output=True, text=True)
    if tried.returncode:
        pytest.skip(f"network namespaces are not allowed here: {tried.stderr.strip()}")
    switch = ["ip", "-n", name, "link", "add", "name", "s", "type", "bridge"]
    made = subprocess.run(switch, capture_output=True, text=True)
    subprocess.run(["ip", "netns", "delete", name], check=True)
    if made.returncode:
        pytest.skip(f"no switch can be made in a network namespace: {made.stderr.strip()}")


@dataclass(frozen=True, slots=True)
class Cable:
    """The link of a machine with the switch. Connections stay when it is pulled: no end sees it."""

    switch: str
    port: str

    def cut(self) -> None:
        """Pull it: the switch passes nothing on, and the link of the machine stays up."""
        _ip("-n", self.switch, "link", "set", "dev", self.port, "nomaster")

    def restore(self) -> None:
        """Plug it in again."""
        _ip("-n", self.switch, "link", "set", "dev", self.port, "master", "switch")


@dataclass(frozen=True, slots=True)
class Machine:
    """A namespace: its address, its cable, and what to put before a command to run it there."""

    name: str
    address: str
    cable: Cable

    @property
    def prefix(self) -> Sequence[str]:
        return ("ip", "netns", "exec", self.name)


@contextmanager
def machines(count: int) -> Iterator[list[Machine]]:
    """Machines on one switch; they are gone at the end, with what still runs in them."""
    need_namespaces()
    with ExitStack() as stack:
        base = f"contid-{os.getpid()}"
        names = [f"{base}-{number}" for number in range(count)]
        for name in (base, *names):
            _ip("netns", "add", name)
            stack.callback(_ip, "netns", "delete", name)
            _ip("-n", name, "link", "set", "dev", "lo", "up")
        _ip("-n", base, "link", "add", "name", "switch", "type", "bridge")
        _ip("-n", base, "link", "set", "dev", "switch", "up")
        found = []
        for number, name in enumerate(names):
            cable, address = Cable(base, f"port{number}"), f"{PREFIX}.{number + 1}"
            _ip(
                "-n",
                base,
                "link",
                "add",
                "name",
                cable.port,
                "type",
                "veth",
                "peer",
                "name",
                "eth",
                "netns",
                name,
            )
            cable.restore()
            _ip("-n", base, "link", "set", "dev", cable.port, "up")
            _ip("-n", name, "address", "add", f"{address}/24", "dev", "eth")
            _ip("-n", name, "link", "set", "dev", "eth", "up")
            found.append(Machine(name, address, cable))
        yield found


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, stdin=subprocess.DEVNULL)
