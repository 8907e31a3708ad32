"""What delays the event loop of a daemon besides its own work: garbage collections and other programs."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from tests.support.command import environment

pytestmark = pytest.mark.process

#: A run that looks at itself while it runs, and afterwards.
RUN = """
import asyncio, gc, json, os, sys
from contid.control.daemon.run import run
from contid.control.daemon.run_request import RunRequest

found = {}
def look(key):
    path = "/proc/self/autogroup"  # missing in some kernels
    group = open(path).read().split()[-1] if os.path.exists(path) else "-10"
    found[key] = [len(gc.get_objects()), os.getpriority(os.PRIO_PROCESS, 0), group]

class Source:
    async def serve(self, control):
        while control.newest() is None:
            await asyncio.sleep(0.01)
        look("inside")
        control.interrupt()

look("before")
run(RunRequest("finger", mock=True, commands=[Source()]))
look("after")
print(json.dumps(found))
"""


def look(own_session: bool) -> dict[str, list[object]]:
    command = [sys.executable, "-c", RUN]
    done = subprocess.run(
        command if own_session else ["setsid", "sh", "-c", 'true; "$@"; true', "sh", *command],
        env=environment(),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=60,
        start_new_session=own_session,
    )
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout.splitlines()[-1]))


@pytest.fixture(scope="module")
def found() -> dict[str, list[object]]:
    return look(own_session=True)


def test_a_garbage_collection_visits_little_while_robots_move(found: dict[str, list[int]]) -> None:
    """A collection of 100 000 containers takes 10 ms and more, of 10 000 one."""
    assert found["inside"][0] < 10_000 < found["before"][0]


@pytest.fixture(scope="module")
def may_raise() -> None:
    probe = "import os; os.setpriority(os.PRIO_PROCESS, 0, -10)"
    if subprocess.run([sys.executable, "-c", probe], capture_output=True).returncode:
        pytest.skip("negative nice values need CAP_SYS_NICE or LimitNICE")


@pytest.mark.usefixtures("may_raise")
def test_a_daemon_goes_before_the_programs_that_flood_it(found: dict[str, list[object]]) -> None:
    assert found["inside"][1:] == [-10, "-10"]
    assert found["after"][1:] == found["before"][1:]


@pytest.mark.usefixtures("may_raise")
def test_the_session_of_a_terminal_keeps_its_priority() -> None:
    """The session is that of a shell; other programs run in it."""
    found = look(own_session=False)
    assert found["inside"][1] == -10
    assert found["inside"][2] == found["before"][2] == found["after"][2]
