"""``python -m contid_learn.drive SOCKET ROBOT_FILE FILE GOAL [SECONDS]``: a policy as a client of a daemon.

It ends with the run, whose other end of its stdin is closed then. Its exit code is 0 when the run ended, or
when its time is over; 1 when it could not go on; 2 for arguments or a policy that are wrong.
"""

from __future__ import annotations

import math
import os
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from contid import Client, Robot
from contid.client import Code, ConnectionLostError, NoDaemonError, RemoteError
from contid.errors import ContidError
from contid.kinematics.array import Array
from contid_learn.goals import goals_of, parse_goal
from contid_learn.policy_file import Policy, PolicyAbout
from contid_learn.policy_loop import PolicyLoop
from contid_learn.views import RobotView, views_of

#: Waits for the daemon [s], and between two looks.
CONNECT_TIMEOUT_S: Final = 60.0
LOOK_S: Final = 0.05

_ended = threading.Event()


@dataclass(frozen=True, slots=True)
class PolicyDrive:
    """A policy, the robots that it moves, and where it is to bring their tips."""

    policy: Policy
    views: tuple[RobotView, ...]
    goals: dict[str, Array]

    @property
    def rate_hz(self) -> float:
        """Actions per second."""
        return self.policy.about.rate_hz

    def loop(self, duration_s: float | None = None) -> PolicyLoop:
        """The controller."""
        return PolicyLoop(self.views, self.policy, self.goals, 1.0 / self.rate_hz, duration_s)


def load_drive(robot_file: str, file: str, goal: str) -> PolicyDrive:
    """Read a policy for the robots of a file, and the text of its goal.

    Raises:
        ContidError: one of them is wrong, or they do not belong together.
    """
    columns = parse_goal(goal)
    policy = Policy(file)
    views = views_of(Robot(robot_file), policy.about.rate_hz)
    fits(policy.about, PolicyAbout.of(views, policy.about.rate_hz, policy.about.task), file)
    return PolicyDrive(policy, views, goals_of(views, columns))


def drive(socket: Path, driven: PolicyDrive, duration_s: float | None) -> None:
    """Drive until the time of the policy is over; raises what went wrong."""
    with _connected(socket) as client:
        client.resume()
        _note(f"moves {', '.join(view.name for view in driven.views)} at {driven.rate_hz:g} Hz")
        with driven.loop(duration_s) as loop:
            try:
                client.servo(driven.rate_hz, loop)
            finally:
                _note(str(loop.counts))
        client.stop(end=True)


def fits(policy: PolicyAbout, robot: PolicyAbout, file: str) -> None:
    """Refuse a policy of another robot.

    Raises:
        ContidError: it moves other axes, or sees another number of values.
    """
    if policy.columns != robot.columns:
        raise ContidError(
            f"{file}: it moves {', '.join(policy.columns)}; these robots have {', '.join(robot.columns)}"
        )
    if policy.width != robot.width:
        raise ContidError(f"{file}: it sees {policy.width} numbers; these robots give {robot.width}")


def _connected(socket: Path) -> Client:
    end_s = time.monotonic() + CONNECT_TIMEOUT_S
    while True:
        try:
            return Client(socket, name="policy")
        except NoDaemonError:
            if _ended.is_set() or time.monotonic() > end_s:
                raise
            time.sleep(LOOK_S)


def _watch_stdin() -> None:
    sys.stdin.buffer.read()
    _ended.set()


def _note(message: str) -> None:
    print(f"contid: policy: {message}", file=sys.stderr, flush=True)  # noqa: T201


def _seconds(text: str) -> float:
    """The time of a policy.

    Raises:
        ContidError: no number, or not above 0.
    """
    try:
        found = float(text)
    except ValueError:
        found = math.nan
    if not 0.0 < found < math.inf:
        raise ContidError(f"SECONDS: {text!r}; allowed: a number above 0")
    return found


def main(arguments: list[str]) -> int:
    """The exit code."""
    if not 4 <= len(arguments) <= 5:
        _note("usage: python -m contid_learn.drive SOCKET ROBOT_FILE FILE GOAL [SECONDS]")
        return 2
    socket, robot_file, file, goal, *rest = arguments
    threading.Thread(target=_watch_stdin, daemon=True).start()
    try:
        driven, duration_s = load_drive(robot_file, file, goal), _seconds(rest[0]) if rest else None
    except ContidError as error:
        _note(f"{error}; nothing was moved")
        return 2
    try:
        drive(Path(socket), driven, duration_s)
    except (ContidError, RemoteError, ConnectionLostError) as error:
        time.sleep(4 * LOOK_S)  # a run that ends closes stdin at about the same time
        if _ended.is_set() or (isinstance(error, RemoteError) and error.code == Code.STOPPED):
            return 0
        _note(f"{error}; the robots hold")
        return 1
    return 0


if __name__ == "__main__":
    code = main(sys.argv[1:])
    sys.stderr.flush()
    os._exit(code)  # a network that hangs must not keep the process
