"""A process that has imported contid and forks for each command: ``python -m ...plugins.starter FD ...``.

Importing is most of the cost of a command of contid (0.3 to 0.8 s of processor time; a fork takes 4 ms).
What a fork runs has its own files, folder, environment, signals, session, umask and arguments, as after
``exec``; it differs in what a fork shares: the seed of hashes, and the modules that are imported already.
The starter has one thread.

A fork must be the child of the process that asked, which waits for it as for any other. The starter
therefore forks twice: the intermediate process ends at once, and the kernel gives its child to the asking
process, which is a "child subreaper" meanwhile (prctl(2)).
"""

from __future__ import annotations

import array
import ctypes
import fcntl
import gc
import importlib
import importlib.util
import io
import json
import os
import pkgutil
import signal
import socket
import struct
import sys
import traceback
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any, Final, TextIO

#: Descriptors that come with a request are moved above this number before they get their own numbers.
ABOVE: Final = 512
#: Space in the command line of the starter for those of its forks.
ROOM: Final = 4096
#: What is imported where it is installed. `contid_view` and `contid_camera` import libraries with threads.
PACKAGES: Final = (
    *(
        "contid",
        "contid_drivers",
        "contid_clearance",
        "contid_contact",
        "contid_dynamics",
        "contid_fit",
        "contid_fleet",
        "contid_hands",
        "contid_panel",
        "contid_paths",
        "contid_ropes",
        "contid_sessions",
        "contid_tendons",
    ),
    *("contid_adapt", "contid_identify", "contid_reach"),
)
#: What functions of contid import when they are called.
LIBRARIES: Final = (
    *("asyncio", "logging.handlers", "scipy.optimize", "scipy.stats", "scipy.spatial", "scipy.linalg"),
    *(
        "scipy.ndimage",
        "shapely.affinity",
        "ruckig",
        "rich.table",
        "rich.console",
        "mcap.reader",
        "mcap.writer",
    ),
    *("zstandard", "lz4.frame", "psutil", "serial", "ruamel.yaml", "uvicorn", "websockets.asyncio.client"),
)
#: The variable with the modules that are imported in place of all these, for a few commands.
ONLY: Final = "STARTER_IMPORTS"
#: A program of a test (`tests.support.command.program`).
PROGRAM: Final = "tests.support.plugins.program"
#: How a ``sitecustomize.py`` begins that may as well run after contid has been imported.
LATE: Final = "# This may run after imports.\n"
#: Commands that start processes of contid themselves: each has a starter of its own.
PARENTS: Final = ("run", "home", "demo")
_CLONE_NEWNET: Final = 0x40000000
_PR_SET_MM: Final = 35
_PR_SET_MM_ARG_END: Final = 9


def receive(connection: socket.socket) -> tuple[dict[str, Any], list[int]] | None:
    """The next request with its descriptors; None when the other end is closed."""
    head, descriptors, _, _ = socket.recv_fds(connection, 4, 64)
    if len(head) < 4:
        return None
    (size,) = struct.unpack("!I", head)
    body = bytearray()
    while len(body) < size:
        body += connection.recv(size - len(body))
    return json.loads(body), list(array.array("i", descriptors))


def send(connection: socket.socket, request: dict[str, Any], descriptors: list[int]) -> None:
    """Send a request with its descriptors."""
    body = json.dumps(request).encode()
    socket.send_fds(connection, [struct.pack("!I", len(body))], descriptors)
    connection.sendall(body)


def import_all(package: ModuleType) -> None:
    """Import the modules of a package that start no threads."""
    for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}.", onerror=lambda _: None):
        if not found.name.endswith("__main__"):
            with suppress(ImportError):
                importlib.import_module(found.name)


def serve(connection: socket.socket) -> None:
    """Fork for each request; returns in forks, and ends with the process at the other end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    while (received := receive(connection)) is not None:
        request, descriptors = received
        signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
        read, write = os.pipe()
        if not (between := os.fork()):
            between = os.getpid()
            if own := os.fork():
                os.write(write, struct.pack("!i", own))
                os._exit(0)
            connection.close()
            _become(request, descriptors, between)
        os.close(write)
        os.waitpid(between, 0)
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
        connection.sendall(os.read(read, 4))
        for number in (read, *descriptors):
            os.close(number)
    os._exit(0)


def _become(request: dict[str, Any], descriptors: list[int], between: int) -> None:
    """Be the process that was asked for; never returns."""
    code = 1
    try:
        _set_files(request["numbers"], descriptors)
        if request["session"]:
            os.setsid()
        elif request["group"] is not None:
            os.setpgid(0, request["group"])
        if request["network"] is not None:
            _enter(request["network"])
        os.umask(request["umask"])
        os.chdir(request["folder"])
        os.environ.clear()
        os.environ.update(request["environment"])
        _set_arguments(request)
        while os.getppid() == between:  # it has not ended yet
            os.sched_yield()
        starts = request["module"] == PROGRAM or {*request["arguments"][:1]} & {*PARENTS}
        parent = _fork_starter() if starts else None
        _set_signals(request)
        if parent is not None:
            _start_by(parent)
        for folder in request["folders"]:
            if (late := Path(folder, "sitecustomize.py")).exists():
                exec(compile(late.read_text(), str(late), "exec"), {"__name__": "sitecustomize"})
        code = _run(request["module"])
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


def _enter(network: str) -> None:
    """Go into a network namespace, as ``ip netns exec`` does."""
    with Path("/var/run/netns", network).open() as file:
        if ctypes.CDLL(None, use_errno=True).setns(file.fileno(), _CLONE_NEWNET):
            raise OSError(ctypes.get_errno(), f"network namespace {network}")


def _set_files(numbers: list[int], descriptors: list[int]) -> None:
    """Descriptors get their numbers, all others are closed, and the standard streams are opened anew."""
    moved = [fcntl.fcntl(number, fcntl.F_DUPFD, ABOVE) for number in descriptors]
    os.closerange(0, ABOVE)
    for source, number in zip(moved, numbers, strict=True):
        os.dup2(source, number, inheritable=True)
        os.close(source)
    open_streams()


def open_streams() -> None:
    """Open the standard streams anew, whose descriptors are others now."""
    for number, name, like in ((0, "stdin", sys.stdin), (1, "stdout", sys.stdout), (2, "stderr", sys.stderr)):
        stream = _open(number, name, like)
        setattr(sys, name, stream)
        setattr(sys, f"__{name}__", stream)


def _open(number: int, name: str, like: TextIO) -> TextIO | None:
    """A standard stream as the interpreter opens it (``create_stdio`` in Python/pylifecycle.c)."""
    try:
        os.fstat(number)
    except OSError:
        return None
    assert isinstance(like, io.TextIOWrapper)
    mode = "wb" if number else "rb"
    unbuffered = bool(number) and bool(os.environ.get("PYTHONUNBUFFERED"))
    buffer = open(number, mode, 0 if unbuffered else -1, closefd=False)  # noqa: SIM115
    raw: Any = buffer if unbuffered else buffer.raw  # type: ignore[attr-defined]
    raw.name = f"<{name}>"
    stream = io.TextIOWrapper(
        buffer,
        encoding=like.encoding,
        errors=like.errors,
        newline="\n",
        line_buffering=number == 2 or (not unbuffered and raw.isatty()),
        write_through=unbuffered,
    )
    stream.mode = "w" if number else "r"  # type: ignore[misc]
    return stream


def _set_arguments(request: dict[str, Any]) -> None:
    """``sys.argv``, ``sys.path`` and ``__main__`` as after ``python -m``; the command line for others."""
    module = request["module"]
    name = f"{module}.__main__" if module == "contid" or module.endswith(".process") else module
    spec = importlib.util.find_spec(name)
    assert spec is not None
    assert spec.origin is not None
    sys.argv[:] = [spec.origin, *request["arguments"]]
    sys.orig_argv[:] = request["command"]
    sys.path[:1] = [*([] if request["safe_path"] else [str(Path.cwd())]), *request["folders"]]
    main = ModuleType("__main__")
    main.__spec__ = spec
    main.__file__ = spec.origin
    main.__loader__ = spec.loader
    main.__package__ = spec.parent
    sys.modules["__main__"] = main
    _show(request["command"])


def _show(command: list[str]) -> None:
    """Overwrite the command line that other processes see."""
    fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
    start, end = int(fields[45]), int(fields[46])  # arg_start, arg_end
    text = "\0".join(command).encode(errors="surrogateescape")[: end - start - 1] + b"\0"
    ctypes.memset(start, 0, end - start)
    ctypes.memmove(start, text, len(text))
    libc = ctypes.CDLL(None)
    libc.prctl(_PR_SET_MM, _PR_SET_MM_ARG_END, ctypes.c_ulong(start + len(text)), 0, 0)  # root only


def _set_signals(request: dict[str, Any]) -> None:
    """What the asking process ignores is ignored, all else has the action of a new interpreter."""
    ignored = set(request["ignored"])
    for number in signal.valid_signals() - {signal.SIGKILL, signal.SIGSTOP}:
        action: Any = signal.SIG_IGN if number in ignored else signal.SIG_DFL
        if number in (signal.SIGPIPE, signal.SIGXFSZ):
            action = signal.SIG_IGN
        elif number == signal.SIGINT and number not in ignored:
            action = signal.default_int_handler
        with suppress(OSError, ValueError):
            signal.signal(number, action)
    signal.pthread_sigmask(signal.SIG_SETMASK, request["blocked"])


def _fork_starter() -> socket.socket:
    """A starter of this process, whose forks are its children."""
    here, there = socket.socketpair()
    if not os.fork():
        here.close()
        null = os.open(os.devnull, os.O_RDWR)
        for number in range(3):
            os.dup2(null, number)
        kept = {0, 1, 2, there.fileno()}
        for path in [*Path("/proc/self/fd").iterdir()]:
            if int(path.name) not in kept:
                with suppress(OSError):
                    os.close(int(path.name))
        _show(["starter"])
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
        serve(there)
    there.close()
    moved = fcntl.fcntl(here.fileno(), fcntl.F_DUPFD_CLOEXEC, ABOVE)  # where a new process has no descriptors
    here.close()
    return socket.socket(fileno=moved)


def _start_by(connection: socket.socket) -> None:
    """Processes that this one starts are forked as well, where they are contid's."""
    import subprocess

    from tests.support.plugins import forked

    forked.use(connection)
    subprocess.Popen = forked.ForkedPopen  # type: ignore[misc]


def _run(module: str) -> int:
    """Run a module as the main program up to the end of the interpreter; its exit code."""
    return finish(_call(module))


def finish(code: int) -> int:
    """What the interpreter does at its end; the exit code."""
    import atexit
    import threading

    with suppress(BaseException):
        threading._shutdown()  # type: ignore[attr-defined]
    with suppress(BaseException):
        atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        if stream is not None and not stream.closed:
            try:
                stream.flush()
            except OSError:
                code = 120
    return code


def _call(module: str) -> int:
    try:
        if module == "contid":
            from contid.entry import main

            main()
        elif module == "contid.control.process":
            from contid.control.process.__main__ import main as control

            return control(*map(int, sys.argv[1:]))
        elif module == PROGRAM:
            from tests.support.plugins.program import main as program

            program()
        else:
            return importlib.import_module(module).main() or 0
    except SystemExit as done:
        if done.code is None or isinstance(done.code, int):
            return done.code or 0
        print(done.code, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        sys.excepthook(*sys.exc_info())
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGINT)
        return 130
    except BaseException:
        sys.excepthook(*sys.exc_info())
        return 1
    return 0


def main() -> None:
    """Import, then serve the process at the other end of a socket."""
    only = os.environ.get(ONLY)
    for name in PACKAGES if only is None else ():
        with suppress(ImportError):
            import_all(importlib.import_module(name))
    for name in LIBRARIES if only is None else only.split():
        with suppress(ImportError):
            importlib.import_module(name)
    assert len([*Path("/proc/self/task").iterdir()]) == 1, "a library started a thread"
    gc.collect()
    gc.freeze()
    serve(socket.socket(fileno=int(sys.argv[1])))


if __name__ == "__main__":
    main()
