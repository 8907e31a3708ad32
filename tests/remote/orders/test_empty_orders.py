"""Orders that would do nothing, or something else than their fields read, are refused."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from contid.client import Client
from contid.remote.client.servo import ServoState
from contid.remote.protocol.wire import RemoteError
from tests.support.daemons import Running, armed_daemon

pytestmark = [pytest.mark.process, pytest.mark.realtime]

HERE = {"f0.x_mm": 50.0, "f0.y_mm": 75.0}


def refusal(client: Client, verb: str, **fields: object) -> str:
    with pytest.raises(RemoteError) as info:
        client.request(verb, **fields)
    return str(info.value)


def states(client: Client) -> dict[str, str]:
    return {name: robot["state"] for name, robot in client.status()["robots"].items()}


@pytest.fixture(scope="module")
def running() -> Iterator[Running]:
    with armed_daemon(2) as found:
        yield found


def test_a_recovery_of_nothing_is_refused_and_lifts_no_stop(running: Running) -> None:
    with running.client(name="a") as client, running.client(name="b") as other:
        other.hold()
        assert "nothing to recover" in refusal(client, "recover", after_stop=True)
        assert "hold" in refusal(client, "move", target=HERE)
        client.request("resume", after_stop=True)


def test_numbers_that_would_mean_something_else_are_refused(running: Running) -> None:
    with running.client(name="a") as client:
        assert "above 0 N" in refusal(client, "move", target=HERE, until_force_n=0.0)
        assert "share: a number from 0 to 1" in refusal(client, "grip")
        assert "at_s" in refusal(client, "start", move=1, at_s=-0.5)


@pytest.mark.parametrize("broken", [math.nan, math.inf])
def test_a_controller_that_returns_no_number_leaves_the_robots_holding(
    running: Running, broken: float
) -> None:
    def controller(state: ServoState) -> dict[str, float]:
        return {**HERE, "f0.x_mm": 50.0 + 0.1 * state.step if state.step < 20 else broken}

    with running.client(name="a") as client:
        client.request("resume", after_stop=True)
        with pytest.raises(RemoteError, match=r"the controller returned f0\.x_mm=(nan|inf)"):
            client.servo(50.0, controller)
        assert states(client)["f0"] == "HOLD"
