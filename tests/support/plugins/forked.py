"""`subprocess.Popen` whose commands of contid fork from the starter instead of importing anew."""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from tests.support.plugins import starter

ROOT: Final = Path(__file__).parents[3]
#: PYTHONPATH of commands; without it they import the installed tree, which is the same (conftest.py).
THIS_TREE: Final = os.pathsep.join((str(ROOT), str(ROOT / "drivers")))
#: What this run was started with, as for a plug-in that measures it.
OWN_PATH: Final = os.environ.get("PYTHONPATH", "")
#: ``python -m MODULE`` that a starter can be. The recorder outlives its daemon, the control process does not.
MODULES: Final = (
    "contid",
    "contid.control.process",
    "contid.session.mcap_recorder",
    "tests.support.fleet_mover",
    starter.PROGRAM,
)
#: What runs a command in a network namespace, whose name follows.
IN_NAMESPACE: Final = ["ip", "netns", "exec"]
#: Variables that the interpreter or a library reads while it starts: where they differ nothing is forked.
READ_AT_START: Final = ("PYTHON", "LC_", "LANG", "TZ", "LD_", "MALLOC_", "CONTID_", "OPENBLAS_", "OMP_")
#: The starter has them, so that it has one thread.
ONE_THREAD: Final = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
_PR_SET_CHILD_SUBREAPER: Final = 36

#: What starts a command as users do.
TruePopen: Final = subprocess.Popen
_lock = threading.Lock()
_connection: socket.socket | None = None
_process: subprocess.Popen[bytes] | None = None
_environment: Mapping[str, str] = {}
#: Orphans that the kernel gave to this process while it was a "child subreaper": no test has started them.
_adopted: set[int] = set()


def environment() -> dict[str, str]:
    """The environment of commands: they import this tree."""
    return {**os.environ, "PYTHONPATH": THIS_TREE}


def use(connection: socket.socket) -> None:
    """Take the starter at the other end, which was forked for this process and has its environment."""
    global _connection, _environment
    _connection, _environment = connection, dict(os.environ)


def close() -> None:
    """End the starter, also where a process that a test has left keeps a copy of the connection."""
    global _connection, _process
    if _connection is not None:
        with suppress(OSError):  # the starter has ended
            _connection.shutdown(socket.SHUT_RDWR)
        _connection.close()
    if _process is not None:
        _process.wait()
    _connection = _process = None


def pid() -> int | None:
    """Process id of the starter, once it runs."""
    return None if _process is None else _process.pid


def children() -> set[int]:
    """Children of every thread of this process, also dead ones that have not been waited for."""
    found: set[int] = set()
    for thread in os.listdir("/proc/self/task"):  # noqa: PTH208 -- at every test
        with suppress(OSError):  # the thread has ended
            found.update(map(int, Path(f"/proc/self/task/{thread}/children").read_text().split()))
    return found


def adopted() -> set[int]:
    """Orphans of processes that ended while this one was their reaper; those that have ended are reaped."""
    for orphan in [*_adopted]:
        try:
            if os.waitpid(orphan, os.WNOHANG)[0]:
                _adopted.discard(orphan)
        except ChildProcessError:
            _adopted.discard(orphan)
    return {*_adopted}


def descriptors() -> set[int]:
    """Descriptors of the connection with it."""
    return set() if _connection is None else {_connection.fileno()}


class ForkedPopen(subprocess.Popen[Any]):
    """A process of ``python -m contid`` that forks from a starter; any other command is started as always."""

    def _execute_child(
        self, args, executable, preexec_fn, close_fds, pass_fds, cwd, env, startupinfo, creationflags, shell,
        p2cread, p2cwrite, c2pread, c2pwrite, errread, errwrite, restore_signals, gid, gids, uid, umask,
        start_new_session, process_group,
    ) -> None:  # fmt: skip
        special = (preexec_fn, executable, gid, gids, uid)
        plain = all(each is None for each in special) and close_fds and not shell and restore_signals
        request = (
            _request(args, os.environ if env is None else env)
            if plain and not isinstance(args, (str, bytes))
            else None
        )
        folder = os.fspath(Path.cwd() if cwd is None else cwd)
        if request is None or not Path(folder).is_dir():
            with _lock:  # what `_fork` finds beside its own process is adopted
                super()._execute_child(  # type: ignore[misc]
                    args, executable, preexec_fn, close_fds, pass_fds, cwd, env, startupinfo, creationflags,
                    shell, p2cread, p2cwrite, c2pread, c2pwrite, errread, errwrite, restore_signals, gid,
                    gids, uid, umask, start_new_session, process_group,
                )  # fmt: skip
            return
        sys.audit("subprocess.Popen", args[0], args, cwd, env)
        own = {
            number: number if source == -1 else source
            for number, source in ((0, p2cread), (1, c2pwrite), (2, errwrite))
        }
        own = {number: source for number, source in own.items() if _is_open(source)}
        own |= {number: number for number in pass_fds}
        status = dict(
            line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines() if ":" in line
        )
        ignored_mask = int(status["SigIgn"], 16)
        request |= {
            "numbers": [*own],
            "folder": folder,
            "session": start_new_session,
            "group": process_group if process_group != -1 else None,
            "umask": int(status["Umask"], 8) if umask < 0 else umask,
            "ignored": [
                number
                for number in map(int, signal.valid_signals())
                if ignored_mask >> (number - 1) & 1 and number not in (signal.SIGPIPE, signal.SIGXFSZ)
            ],
            "blocked": sorted(map(int, signal.pthread_sigmask(signal.SIG_BLOCK, ()))),
        }
        self.pid = _fork(request, [*own.values()])
        self._child_created = True
        self._close_pipe_fds(p2cread, p2cwrite, c2pread, c2pwrite, errread, errwrite)  # type: ignore[attr-defined]


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


def _request(args: Sequence[Any], env: Mapping[str, str]) -> dict[str, Any] | None:
    """What to fork; None for what a starter cannot be."""
    if not all(isinstance(each, (str, os.PathLike)) for each in args):
        return None
    words, network = [os.fspath(each) for each in args], None
    if words[:3] == IN_NAMESPACE:
        network, words = words[3], words[4:]
    safe_path = words[1:2] == ["-P"]
    rest = words[2:] if safe_path else words[1:]
    if words[0] != sys.executable or rest[:1] != ["-m"] or not set(rest[1:2]) & {*MODULES}:
        return None
    folders = _folders(env)
    if folders is None or not _same_start(env, _environment if _connection is not None else os.environ):
        return None
    return {
        "module": rest[1],
        "arguments": rest[2:],
        "command": words,
        "safe_path": safe_path,
        "network": network,
        "folders": folders,
        "environment": {str(key): str(value) for key, value in env.items()},
    }


def _folders(env: Mapping[str, str]) -> list[str] | None:
    """What PYTHONPATH names before this tree; None for another tree, or code that must run first."""
    path = env.get("PYTHONPATH") or THIS_TREE
    if path == OWN_PATH:
        path = os.pathsep.join((path, THIS_TREE))
    if path != THIS_TREE and not path.endswith(os.pathsep + THIS_TREE):
        return None
    folders = [each for each in path.removesuffix(THIS_TREE).split(os.pathsep) if each]
    codes = [code.read_text() for each in folders if (code := Path(each, "sitecustomize.py")).exists()]
    return folders if all(text.startswith(starter.LATE) for text in codes) else None


def _same_start(first: Mapping[str, str], second: Mapping[str, str]) -> bool:
    """Whether interpreters start alike in two environments."""

    def read(variables: Mapping[str, str]) -> dict[str, str]:
        return {
            key: value
            for key, value in variables.items()
            if key.startswith(READ_AT_START) and ONE_THREAD.get(key) != value and key != "PYTHONPATH"
        }

    return read(first) == read(second)


def _fork(request: dict[str, Any], descriptors: list[int]) -> int:
    with _lock:
        connection = _start()
        libc = ctypes.CDLL(None)
        before = children()
        libc.prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        try:
            starter.send(connection, request, descriptors)
            (own,) = struct.unpack("!i", connection.recv(4, socket.MSG_WAITALL))
        finally:
            libc.prctl(_PR_SET_CHILD_SUBREAPER, 0, 0, 0, 0)
        _adopted.update(children() - before - {own})
    return int(own)


def _start() -> socket.socket:
    """The starter, begun at the first command."""
    global _connection, _process, _environment
    if _connection is None:
        here, there = socket.socketpair()
        _environment = environment()
        with there:
            command = [sys.executable, "-m", "tests.support.plugins.starter", str(there.fileno())]
            _process = TruePopen(
                [*command, "-" * starter.ROOM],
                pass_fds=[there.fileno()],
                stdin=subprocess.DEVNULL,
                cwd=ROOT,
                env={**_environment, **ONE_THREAD},
            )
        _connection = here
    return _connection
