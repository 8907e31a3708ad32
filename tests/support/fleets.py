"""Real bridges before real daemons on simulated devices, and operators in processes of their own."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from contid_fleet.fleet_file import OperatorFile, load_operator_file
from tests.support.daemons import Running, command, daemon

RIGHTS = ("watch", "move", "arm", "measure")


@dataclass
class BridgeProcess:
    """`contid fleet serve`, its files, and its messages.

    Attributes:
        keys: further keys of the files of operators.
        prefix: of the commands of operators.
    """

    process: subprocess.Popen[str]
    folder: Path
    endpoint: str
    keys: Mapping[str, Any] = field(default_factory=dict)
    prefix: Sequence[str] = ()

    def operator_file(self, name: str = "anna", expected: Sequence[str] = (), **keys: Any) -> Path:
        path = self.folder / f"{name}.yaml"
        contents = {"fleet": "lab", "connect": [self.endpoint], "operator": name, "expected": [*expected]}
        contents |= {**self.keys, **keys}
        path.write_text(yaml.safe_dump(contents))
        return path

    def operator(self, name: str = "anna", expected: Sequence[str] = (), **keys: Any) -> OperatorFile:
        return load_operator_file(self.operator_file(name, expected, **keys))


def machine_file(folder: Path, endpoint: str, nodes: Mapping[str, Path], **keys: object) -> Path:
    """The file of a machine on which anna may do everything and bob may watch."""
    path = folder / "machine.yaml"
    contents: dict[str, object] = {
        "fleet": "lab",
        "listen": [endpoint],
        "trust_local_users": True,
        "nodes": {name: str(socket) for name, socket in nodes.items()},
        "operators": {"anna": [*RIGHTS], "bob": ["watch"]},
        **keys,
    }
    path.write_text(yaml.safe_dump({key: value for key, value in contents.items() if value is not None}))
    return path


@contextmanager
def bridge(
    nodes: Mapping[str, Path],
    env: Mapping[str, str] | None = None,
    endpoint: str | None = None,
    arguments: Sequence[str] = (),
    prefix: Sequence[str] = (),
    **keys: object,
) -> Iterator[BridgeProcess]:
    """`contid fleet serve`, at a Unix socket if no endpoint is given, from its ready message on."""
    folder = Path(tempfile.mkdtemp(prefix="contid-"))
    endpoint = endpoint or f"unixsock-stream/{folder}/net"
    path = machine_file(folder, endpoint, nodes, **keys)
    with _ready(folder, endpoint, [*prefix, *command("fleet", "serve", str(path), *arguments)], env) as begun:
        yield begun


@contextmanager
def router(
    machines: Mapping[str, Sequence[str]],
    endpoint: str | None = None,
    prefix: Sequence[str] = (),
    **keys: Any,
) -> Iterator[BridgeProcess]:
    """`contid fleet route`, at a Unix socket if no endpoint is given, from its ready message on."""
    folder = Path(tempfile.mkdtemp(prefix="contid-"))
    endpoint = endpoint or f"unixsock-stream/{folder}/net"
    path = router_file(folder, endpoint, machines, **keys)
    with _ready(folder, endpoint, [*prefix, *command("fleet", "route", str(path))]) as begun:
        yield begun


def router_file(folder: Path, endpoint: str, machines: Mapping[str, Sequence[str]], **keys: Any) -> Path:
    """The file of a router through which anna may do everything and bob may watch."""
    path = folder / "router.yaml"
    contents: dict[str, Any] = {
        "fleet": "lab",
        "listen": [endpoint],
        "trust_local_users": True,
        "machines": {name: [*nodes] for name, nodes in machines.items()},
        "operators": {"anna": [*RIGHTS], "bob": ["watch"]},
        **keys,
    }
    path.write_text(yaml.safe_dump({key: value for key, value in contents.items() if value is not None}))
    return path


@contextmanager
def _ready(
    folder: Path, endpoint: str, arguments: Sequence[str], env: Mapping[str, str] | None = None
) -> Iterator[BridgeProcess]:
    """A bridge or a router from its ready message on; its folder goes with it."""
    process = subprocess.Popen(
        arguments,
        stdin=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=None if env is None else {**env},
    )
    assert process.stderr is not None
    try:
        seen = []
        while "is ready at" not in (line := process.stderr.readline()):
            seen.append(line)
            assert line, "".join(seen)
        yield BridgeProcess(process, folder, endpoint)
    finally:
        process.terminate()
        process.send_signal(18)  # SIGCONT, for a test that stopped it
        _, errors = process.communicate(timeout=20)
        shutil.rmtree(folder, ignore_errors=True)
        assert "Traceback" not in errors, errors


@dataclass
class Fleet:
    """Two daemons and their bridge."""

    daemons: Mapping[str, Running]
    bridge: BridgeProcess


@contextmanager
def fleet(**keys: Any) -> Iterator[Fleet]:
    """Nodes hand1 and hand2 on one machine."""
    with ExitStack() as stack:
        daemons = {name: stack.enter_context(daemon()) for name in ("hand1", "hand2")}
        sockets = {name: each.socket for name, each in daemons.items()}
        yield Fleet(daemons, stack.enter_context(bridge(sockets, **keys)))


class NotBegunError(AssertionError):
    """A program that should move a robot did not begin: its lease lapsed first, on a busy machine."""


@contextmanager
def mover(bridge: BridgeProcess, node: str, lease_s: float) -> Iterator[subprocess.Popen[str]]:
    """A program of anna that moves a node with live rows; it has begun."""
    program = [*bridge.prefix, *command()[:1], "-m", "tests.support.fleet_mover"]
    process = subprocess.Popen(
        [*program, str(bridge.operator_file()), node, str(lease_s)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,  # it ends with a traceback when the robots hold
        text=True,
    )
    assert process.stdout is not None
    try:
        if process.stdout.readline() != "moving\n":
            raise NotBegunError(f"no motion of {node} with a lease of {lease_s:g} s")
        yield process
    finally:
        process.kill()
        process.communicate()
