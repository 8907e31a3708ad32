"""The keeper of a kept process: forks it at every start, forwards its output, reports its end, ends it.

The process is that of a bus or of a model. The keeper is forked before the control process has real-time
priority, threads or shared memory, and imports nothing foreign. It ends when the control process does, and
takes with it everything that its process has started.
"""

from __future__ import annotations

import ctypes
import json
import logging
import os
import select
import signal
import socket
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from contid.control.process.isolation import served_process
from contid.control.process.isolation.output import LineLimit
from contid.control.process.isolation.served_process import LONGEST_RUN_US, ServedProcess

#: Orders of the control process.
OPEN: Final = b"open"
END: Final = b"end"
#: Bytes of output per read, and the pause after one, which bound what a flood costs.
PIECE: Final = 1 << 14
PAUSE_S: Final = 0.01
#: Priority under SCHED_FIFO: above the processes that foreign code may start, below every bus.
PRIORITY: Final = 1
#: Longest time that the kept process has at the end of the control process, when it does not end by itself.
REST_S: Final = 0.5
#: Longest time to end what foreign code has started; it may start more meanwhile.
REAPED_S: Final = 1.0
#: Options of prctl(2).
_PR_SET_PDEATHSIG: Final = 1
_PR_SET_CHILD_SUBREAPER: Final = 36


class Keeper:
    """One keeper, in its own process.

    Args:
        control: the socket to the control process.
        logger: name of the log records that are made of printed lines.
        served: what its processes serve.
        body: of the bus or the model.
    """

    def __init__(self, control: socket.socket, logger: str, served: type[ServedProcess], body: bytes) -> None:
        self._control = control
        self._served = served
        self._body = body
        self._limit = LineLimit(logger)
        self._output, self._output_end = os.pipe()
        os.set_blocking(self._output, False)
        self._child = 0
        self._unsent: list[bytes] = []
        self._woken, wake = os.pipe()
        for each in (self._woken, wake):
            os.set_blocking(each, False)
        signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda number, frame: None)
        # The end of the control process comes twice: as the end of the socket, and as this signal. It only
        # wakes the loop: raised in the middle of the end it would cut the time of the kept process.
        self._left = False
        signal.signal(signal.SIGTERM, self._note_end)

    def _note_end(self, number: int, frame: Any) -> None:
        self._left = True

    def serve(self) -> None:
        """Carry out orders until the control process closes its end."""
        pause_ends_s = 0.0  # no output is read before that
        try:
            while True:
                pause_left_s = max(pause_ends_s - time.monotonic(), 0.0)
                watched = [self._control, self._woken, *(() if pause_left_s else (self._output,))]
                timeout_s = pause_left_s or (PAUSE_S if self._unsent else 1.0)
                ready = select.select(watched, (), (), timeout_s)[0]
                if self._woken in ready:
                    os.read(self._woken, PIECE)
                if self._left:
                    return
                if self._output in ready or not ready:
                    self._forward()
                    pause_ends_s = time.monotonic() + PAUSE_S if ready else 0.0
                self._reap()
                self._send()
                if self._control in ready and not self._obey():
                    return
        finally:
            self._wait_for_rest()
            self._end()

    def _wait_for_rest(self) -> None:
        """Time for the kept process to bring devices without a watchdog to rest; it sees the end as well."""
        end_s = time.monotonic() + REST_S
        with suppress(ChildProcessError):
            while self._child and time.monotonic() < end_s and ended_child(os.P_PID, self._child) == 0:
                time.sleep(0.005)

    def _obey(self) -> bool:
        """Carry out an order; False when the control process is gone."""
        order, descriptors, _, _ = socket.recv_fds(self._control, 16, 1)
        if order in (OPEN, END):
            self._end()
        for descriptor in descriptors:
            if order == OPEN:
                self._fork(descriptor)
            os.close(descriptor)
        return bool(order)

    def _fork(self, connection: int) -> None:
        keeper = os.getpid()
        self._child = os.fork()
        if self._child:
            with suppress(OSError):  # the child does it as well, whichever is first
                os.setpgid(self._child, self._child)
            self._unsent.append(json.dumps({"pid": self._child}).encode())
            return
        code = 1
        try:
            # `served_process.main` gives SIGTERM, SIGCHLD and SIGALRM their default action; other signals
            # keep what the control process had set before it forked the keeper.
            signal.set_wakeup_fd(-1)
            os.setpgid(0, 0)
            bind(keeper, signal.SIGKILL)
            code = served_process.main(self._served, connection, self._output_end, self._body)
        except BaseException as error:  # the traceback goes into the log
            logging.getLogger().exception("%s: %s", type(error).__name__, error)
        finally:
            os._exit(code)

    def _end(self) -> int:
        """End the kept process and everything that it has started; returns its status as `os.waitpid`.

        A process that has ended keeps its number until it is waited for, so its group is killed before that:
        afterwards the number could be that of others.
        """
        status = 0
        if self._child:
            with suppress(ProcessLookupError):
                os.killpg(self._child, signal.SIGKILL)
            with suppress(ChildProcessError):
                status = os.waitpid(self._child, 0)[1]
            self._child = 0
        # It is the reaper of what left the group of the kept process: those are its children now.
        children = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children")
        end_s = time.monotonic() + REAPED_S
        while (found := children.read_text().split()) and time.monotonic() < end_s:
            for child in map(int, found):
                with suppress(ProcessLookupError, ChildProcessError):
                    os.kill(child, signal.SIGKILL)
                    os.waitpid(child, 0)
        return status

    def _reap(self) -> None:
        """Report the end of the kept process; others are orphans of it."""
        with suppress(ChildProcessError):
            while pid := ended_child(os.P_ALL, 0):
                if pid == self._child:
                    status = self._end()
                    self._forward()
                    report = {"ended": how_ended(status), "of": pid}
                    self._unsent.append(json.dumps(report).encode())
                else:
                    os.waitpid(pid, 0)

    def _forward(self) -> None:
        """Forward a piece of the output."""
        data = b""
        with suppress(BlockingIOError):
            data = os.read(self._output, PIECE)
        for record in self._limit.take(data, time.monotonic()):
            with suppress(BlockingIOError):  # a control process that reads none loses lines
                self._control.send(json.dumps({"log": record}).encode(), socket.MSG_DONTWAIT)

    def _send(self) -> None:
        with suppress(BlockingIOError):
            while self._unsent:
                self._control.send(self._unsent[0], socket.MSG_DONTWAIT)
                del self._unsent[0]


def ended_child(kind: int, number: int) -> int:
    """A child that has ended and was not waited for yet, 0 without one; arguments as of `os.waitid`."""
    found = os.waitid(kind, number, os.WEXITED | os.WNOHANG | os.WNOWAIT)
    return 0 if found is None else found.si_pid


def how_ended(status: int) -> str:
    """The end of a process, for a person; ``status`` as of `os.waitpid`."""
    if not os.WIFSIGNALED(status):
        return f"exited with status {os.waitstatus_to_exitcode(status)}"
    number = os.WTERMSIG(status)
    if number == signal.SIGXCPU:
        longest_s = LONGEST_RUN_US / 1e6
        return f"computed for {longest_s:g} s without a pause and was ended"
    try:
        return f"was ended by {signal.Signals(number).name}"
    except ValueError:
        return f"was ended by signal {number}"


def bind(parent: int, number: int) -> None:
    """Get a signal when the parent ends; exits when it has ended already."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(number), 0, 0, 0)
    if os.getppid() != parent:
        os._exit(0)


def start(logger: str, served: type[ServedProcess], body: bytes) -> tuple[int, socket.socket]:
    """Fork a keeper; its process id, and the socket to it. Arguments as of `Keeper`."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    control = os.getpid()
    keeper = os.fork()
    if keeper:
        theirs.close()
        return keeper, ours
    try:
        bind(control, signal.SIGTERM)
        signal.signal(signal.SIGTERM, _exit_at_once)  # until there is a `Keeper`
        for number in (signal.SIGINT, signal.SIGHUP):  # of a terminal; the process before it decides
            signal.signal(number, signal.SIG_IGN)
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
        kept = theirs.detach()
        os.closerange(3, kept)
        os.closerange(kept + 1, 1 << 16)
        Keeper(socket.socket(fileno=kept), logger, served, body).serve()
    except BaseException:
        os._exit(1)
    finally:
        os._exit(0)


def _exit_at_once(number: int, frame: Any) -> None:
    raise SystemExit(0)
