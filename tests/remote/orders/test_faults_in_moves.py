"""Trajectories of clients whose robots go to FAULT on the way, in virtual time."""

from __future__ import annotations

import asyncio

import pytest

from contid.client import Code, RemoteError
from contid.control.engine.sources import Timed
from contid.control.tick.faults import Fault
from contid_library.async_client import AsyncClient
from tests.support.virtual.daemon import VirtualDaemon, in_virtual_time, serving

COLUMNS = ("t_s", "left.x_mm", "left.y_mm", "right.x_mm", "right.y_mm")
#: Each finger goes to and fro for half a minute.
ROWS = [(10.0 * k, 40.0 + k % 2, 75.0, 60.0 - k % 2, 75.0) for k in range(4)]


def ended(faulty: tuple[int, ...]) -> tuple[RemoteError, float]:
    """How the trajectory ends where robots go to FAULT on its way, and how long after that [s]."""

    async def play() -> tuple[RemoteError, float]:
        run, loop = VirtualDaemon("hand", lambda robots: None), asyncio.get_running_loop()
        async with serving(run) as path, AsyncClient(path) as client:
            await client.resume()
            playing = asyncio.create_task(client.stream(COLUMNS, ROWS))
            # Its check takes real time, in a thread, while this time goes on.
            while not (isinstance(source := run.engine.selector.source, Timed) and source.time_s > 1.0):
                await asyncio.sleep(0.1)
            for index in faulty:
                run.engine.robots.fail(index, Fault.INTERNAL, "of the test", loop.time())
                await asyncio.sleep(0.1)
            faulted_s = loop.time()
            with pytest.raises(RemoteError) as raised:
                await playing
            return raised.value, loop.time() - faulted_s

    return in_virtual_time(play)


def test_a_trajectory_of_which_every_robot_is_in_fault_ends_at_once() -> None:
    error, after_s = ended((0, 1))
    assert after_s < 2.0
    assert (error.code, list(error.faults)) == (Code.FAULT, ["left", "right"])


@pytest.mark.slow
def test_a_trajectory_that_one_robot_follows_goes_on_to_its_end() -> None:
    error, after_s = ended((1,))
    assert after_s > 20.0
    assert list(error.faults) == ["right"]
