"""Workers of pytest-xdist fork from one process that has imported the tests, and what they import, once.

Each worker collects all tests, and most of the time that it takes are the same imports. The command therefore
starts one process that collects modules without their tests. A worker is then a fork of it: in place of a
Python, pytest-xdist starts a small program (`worker_client.py`), which sends its standard streams to that
process and ends with the worker.
"""

from __future__ import annotations

import gc
import os
import select
import shlex
import signal
import socket
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Final, NoReturn

import pytest

from tests.support.plugins import starter

ROOT: Final = Path(__file__).parents[3]
CLIENT: Final = Path(__file__).parent / "worker_client.py"
#: What is imported in workers only: it imports libraries that start threads, which a fork would not have.
IMPORTED_LATE: Final = ("extras/view/tests/", "extras/sessions/tests/test_exports.py")
#: What it sends when it has imported the tests.
READY: Final = b"r"
#: Workers that have not ended this long after the command did are killed [s].
END_S: Final = 10.0
_ORIGIN: Final = pytest.StashKey["Origin"]()


class Origin:
    """The process that workers fork from."""

    def __init__(self, arguments: Sequence[str]) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="contid-")
        self.path = Path(self._folder.name) / "s"
        self._control, theirs = socket.socketpair()
        with theirs, socket.socket(socket.AF_UNIX) as listening:
            listening.bind(str(self.path))
            listening.listen(64)
            numbers = [theirs.fileno(), listening.fileno()]
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tests.support.plugins.workers", *map(str, numbers), *arguments],
                cwd=ROOT,
                pass_fds=numbers,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
            )

    def ready(self) -> bool:
        """Wait until it has imported the tests; False when it ended instead, and has printed why."""
        return self._control.recv(1) == READY

    def spent_s(self) -> float:
        """Processor time of the process itself; workers count for themselves."""
        fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def close(self) -> None:
        """End it, after its workers."""
        self._control.close()
        self._process.wait()
        self._folder.cleanup()


def spent_s(config: pytest.Config) -> float:
    """Processor time of the process that workers fork from, none for a run without one."""
    origin = config.stash.get(_ORIGIN, None)
    return 0.0 if origin is None else origin.spent_s()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes(config: pytest.Config, specs: Sequence[Any]) -> None:
    """Workers on this machine are forks."""
    if len(specs) < 2 or any(not spec.popen or spec.python for spec in specs):
        return
    origin = Origin(config.invocation_params.args)
    config.add_cleanup(origin.close)
    if not origin.ready():  # workers are started as always, and each imports the tests
        return
    config.stash[_ORIGIN] = origin
    for spec in specs:
        spec.python = shlex.join([sys.executable, "-I", "-S", str(CLIENT), str(origin.path)])


class _NotImported(pytest.File):
    """A module that workers import themselves."""

    def collect(self) -> list[pytest.Item]:
        return []


class _OnlyModules:
    """A plug-in that imports the modules of tests and makes no test of them."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self._patch = patch

    @pytest.hookimpl(tryfirst=True)
    def pytest_configure(self) -> None:
        # Its thread would be missing in forks.
        self._patch.setattr("pytest_rerunfailures.HAS_PYTEST_HANDLECRASHITEM", False)

    @pytest.hookimpl(tryfirst=True)
    def pytest_pycollect_makemodule(self, module_path: Path, parent: pytest.Collector) -> pytest.File | None:
        late = str(module_path).removeprefix(f"{ROOT}/").startswith(IMPORTED_LATE)
        return _NotImported.from_parent(parent, path=module_path) if late else None

    @pytest.hookimpl(tryfirst=True)
    def pytest_pycollect_makeitem(self) -> list[pytest.Item]:
        return []

    @pytest.hookimpl(wrapper=True)
    def pytest_make_collect_report(self, collector: pytest.Collector) -> Any:
        report = yield
        if not report.passed:  # a worker imports it again and reports why it cannot
            for name, module in [*sys.modules.items()]:
                if getattr(module, "__file__", None) == str(collector.path):
                    del sys.modules[name]
        return report


def _import_tests(arguments: Sequence[str]) -> None:
    """Import what a run with these arguments collects."""
    options = ("-n", "0", "--collect-only", "-p", "no:cacheprovider", "-p", "no:junitxml")
    with pytest.MonkeyPatch.context() as patch:
        pytest.main([*arguments, *options], plugins=[_OnlyModules(patch)])
    gc.unfreeze()
    gc.collect()
    gc.freeze()


def _serve(control: socket.socket, listening: socket.socket) -> None:
    """Fork for each client until the command ends; returns in forks never."""
    workers = set()
    while control not in select.select([control, listening], [], [])[0]:
        client, _ = listening.accept()
        with client:
            _, descriptors, _, _ = socket.recv_fds(client, 1, 3)
            if not (worker := os.fork()):
                for each in (control, listening):
                    each.close()
                client.detach()  # it stays open until this process ends
                _become_worker(descriptors)
            workers.add(worker)
            for number in descriptors:
                os.close(number)
    deadline = time.monotonic() + END_S
    while workers:
        workers -= {worker for worker in workers if os.waitpid(worker, os.WNOHANG)[0]}
        if time.monotonic() > deadline:
            for worker in workers:
                os.kill(worker, signal.SIGKILL)
        time.sleep(0.02)


def _become_worker(descriptors: Sequence[int]) -> NoReturn:
    """Run what execnet sends, as ``python -c`` does."""
    code = 1
    try:
        for number, descriptor in enumerate(descriptors):
            os.dup2(descriptor, number, inheritable=True)
            os.close(descriptor)
        starter.open_streams()
        signal.signal(signal.SIGINT, signal.default_int_handler)
        main = sys.modules["__main__"] = ModuleType("__main__")
        sys.argv[:] = ["-c"]
        exec(eval(sys.stdin.readline()), main.__dict__)
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(starter.finish(code))


def main() -> None:
    """Import, then fork."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    numbers, arguments = [int(each) for each in sys.argv[1:3]], sys.argv[3:]
    _import_tests(arguments)
    threads = [(path / "comm").read_text().strip() for path in Path("/proc/self/task").iterdir()]
    if len(threads) > 1:
        named = ", ".join(threads)
        print(f"importing the tests starts threads ({named}): each worker imports them", file=sys.stderr)
        sys.exit(1)
    control, listening = (socket.socket(fileno=number) for number in numbers)
    control.send(READY)
    _serve(control, listening)
    os._exit(0)  # modules that are never taken apart have nothing to report


if __name__ == "__main__":
    main()
