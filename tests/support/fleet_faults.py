"""What stands still or dies while rows are streamed by network, and how soon the robot holds then."""

from __future__ import annotations

import math
import random
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Final, Protocol

from contid.client import Client
from contid_fleet.net_settings import LINK_LEASE_S
from tests.support.daemons import Running, states
from tests.support.fleets import BridgeProcess, bridge, mover
from tests.support.ports import free_port
from tests.support.relay import Relay
from tests.support.waiting import until

#: A cut that the lease outlasts.
SHORT_CUT_S: Final = 0.3
#: The robot is watched for so long after a fault that must not hold it, or to see that it stays.
AFTER_S: Final = 0.7
MOVING: Final = {"RUN"}


@dataclass(frozen=True, slots=True)
class FleetFault:
    """A row of the table.

    Attributes:
        name: of the row.
        limit_s: the promise without its 50 ms, for a lease; infinite when the robot must not hold.
    """

    name: str
    limit_s: Callable[[float], float]


def _at_once(lease_s: float) -> float:
    return 0.0


def _lease(lease_s: float) -> float:
    return lease_s


def _link(lease_s: float) -> float:
    return min(lease_s, LINK_LEASE_S)


FAULTS: Final = {
    each.name: each
    for each in (
        FleetFault("client killed", _at_once),
        FleetFault("client stopped", _link),
        FleetFault("client hangs", _lease),
        FleetFault("bridge killed", _at_once),
        FleetFault("bridge stopped", _lease),
        FleetFault("link cut", _link),
        FleetFault("link cut for 300 ms", lambda lease_s: math.inf),
    )
}


#: The same with a router between program and bridge: `strike` needs it.
ROUTER_FAULTS: Final = {
    each.name: each for each in (FleetFault("router killed", _at_once), FleetFault("router stopped", _link))
}


class Cuttable(Protocol):
    """A link that can fall silent: a relay, or the cable of a machine."""

    def cut(self) -> None:
        """Pass nothing on from now; connections stay."""

    def restore(self) -> None:
        """Pass on again."""


def leases(fault: FleetFault, chosen: random.Random) -> float:
    """A lease: one that lapses first, or not; a short cut is outlasted."""
    return (
        chosen.choice([0.8, 1.0]) if fault.limit_s(1.0) == math.inf else chosen.choice([0.3, 0.5, 1.0, 2.0])
    )


@contextmanager
def linked(nodes: Mapping[str, Running]) -> Iterator[tuple[BridgeProcess, Relay]]:
    """A bridge at a TCP port, and a relay before it, to which operators connect."""
    port = free_port()
    sockets = {name: node.socket for name, node in nodes.items()}
    with (
        bridge(sockets, endpoint=f"tcp/127.0.0.1:{port}") as served,
        Relay(port) as relay,
    ):
        yield BridgeProcess(served.process, served.folder, f"tcp/127.0.0.1:{relay.port}"), relay


def measure(node: Running, fault: FleetFault, lease_s: float, delay_s: float) -> float:
    """Seconds from a fault to the first tick in HOLD, with a bridge and a relay of its own.

    Args:
        node: its daemon, armed.
        fault: what happens.
        lease_s: of the program that moves it.
        delay_s: from the first rows to the fault.

    Raises:
        AssertionError: it moves again after the hold.
    """
    with linked({"hand1": node}) as (served, relay):
        return strike(node, "hand1", served, relay, fault, lease_s, delay_s)


def strike(
    node: Running,
    name: str,
    served: BridgeProcess,
    link: Cuttable,
    fault: FleetFault,
    lease_s: float,
    delay_s: float,
    begun: Callable[[subprocess.Popen[str]], None] = lambda process: None,
    router: BridgeProcess | None = None,
) -> float:
    """Seconds from a fault to the first tick in HOLD; infinite when the robot does not hold.

    The robot is armed again at the end. A bridge that was killed stays dead.

    Args:
        node: its daemon, armed.
        name: of the node.
        served: its bridge, as operators reach it.
        link: between operator and bridge.
        fault: what happens.
        lease_s: of the program that moves it.
        delay_s: from the first rows to the fault.
        begun: called before that with the program that moves it.
        router: that operators connect to instead.

    Raises:
        AssertionError: it moves again after the hold.
    """
    with ExitStack() as stack:
        moving = stack.enter_context(mover(router or served, name, lease_s))
        client = stack.enter_context(node.client())
        frames = client.telemetry(200.0, fields=["state", "command"])
        begun(moving)
        time.sleep(delay_s)
        begin_s = time.monotonic()
        match fault.name:
            case "client killed":
                moving.kill()
            case "client stopped":
                moving.send_signal(signal.SIGSTOP)
            case "client hangs":
                moving.send_signal(signal.SIGUSR1)
            case "bridge killed":
                served.process.kill()
            case "bridge stopped":
                served.process.send_signal(signal.SIGSTOP)
            case "router killed" if router is not None:
                router.process.kill()
            case "router stopped" if router is not None:
                router.process.send_signal(signal.SIGSTOP)
            case _:
                link.cut()
        short = fault.limit_s(lease_s) == math.inf
        end_s = begin_s + (AFTER_S + SHORT_CUT_S if short else fault.limit_s(lease_s) + 10.0)
        held_s = math.inf
        for frame in frames:
            if short and time.monotonic() > begin_s + SHORT_CUT_S:
                link.restore()
            if frame["t_s"] > begin_s and frame["robots"]["f0"]["state"] == "HOLD":
                held_s = frame["t_s"] - begin_s
                break
            if frame["t_s"] > end_s:
                break
        frames.close()
        for process in (moving, served.process, *([] if router is None else [router.process])):
            process.send_signal(signal.SIGCONT)  # what waited must move nothing
        link.restore()
        if held_s < math.inf:
            stays(client)
    _resume(node)
    return held_s


def stays(client: Client) -> None:
    """The command stands still once the stop with limited jerk is over."""
    time.sleep(0.5)
    before = client.status()["robots"]["f0"]["axes"]
    time.sleep(AFTER_S)
    after = client.status()["robots"]["f0"]
    assert after["state"] == "HOLD"
    commands = {name: axis["command_mm"] for name, axis in after["axes"].items()}
    assert commands == {name: axis["command_mm"] for name, axis in before.items()}


def _resume(node: Running) -> None:
    with node.client() as client:
        until(lambda: client.status()["lease"]["holder"] is None, "the lease is free")
        client.resume(after_stop=True)
        until(lambda: states(client) <= {"HOLD", *MOVING}, "it is armed")
