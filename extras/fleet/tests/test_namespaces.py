"""The fault table between machines of their own: TLS over a switch whose cables are pulled."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from contid_fleet.certificates import make_ca, make_certificate
from tests.support.daemons import Running, armed, daemon
from tests.support.fleet_faults import FAULTS, ROUTER_FAULTS, FleetFault, strike
from tests.support.fleets import BridgeProcess, bridge, router
from tests.support.namespaces import Machine, machines

pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: The promise is min(lease, lease of the link) + 50 ms; the rest is for a machine that does other work too.
MARGIN_S = 1.25
#: A lease was renewed, and a sign of life sent, up to a quarter of a second before a fault.
EARLY_S = 0.35
OPERATORS = {"anna": ["watch", "move", "arm"]}


@dataclass
class Lab:
    """A daemon, and machines for its bridge, for a router, and for an operator; certificates for each."""

    node: Running
    robot: Machine
    hub: Machine
    station: Machine
    certificates: Path

    def tls(self, name: str) -> dict[str, str]:
        own = {
            key: str(self.certificates / f"{name}.{end}")
            for key, end in (("certificate", "pem"), ("key", "key"))
        }
        return {"ca": str(self.certificates / "ca.pem"), **own}

    def operated(self, served: BridgeProcess) -> BridgeProcess:
        """As an operator at its station reaches it."""
        served.keys, served.prefix = {"tls": self.tls("anna")}, self.station.prefix
        return served


@pytest.fixture(scope="module")
def lab() -> Iterator[Lab]:
    with ExitStack() as stack:
        robot, hub, station = stack.enter_context(machines(3))
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="contid-")))
        make_ca(folder, "lab")
        make_certificate(folder, folder, "pc1", [robot.address])
        make_certificate(folder, folder, "hub", [hub.address])
        make_certificate(folder, folder, "anna")
        node = stack.enter_context(daemon())
        with node.client() as client:
            armed(client)
        yield Lab(node, robot, hub, station, folder)


def bounded(held_s: float, fault: FleetFault, lease_s: float) -> None:
    limit_s = fault.limit_s(lease_s)
    if limit_s == math.inf:
        assert held_s == math.inf
    else:
        assert limit_s - EARLY_S < held_s < limit_s + MARGIN_S


@pytest.mark.parametrize(
    ("name", "lease_s"),
    [
        ("client killed", 5.0),
        ("client stopped", 0.5),
        ("client stopped", 5.0),
        ("client hangs", 0.5),
        ("bridge killed", 5.0),
        ("bridge stopped", 0.5),
        ("link cut", 0.5),
        ("link cut", 5.0),
        ("link cut for 300 ms", 1.0),
    ],
)
def test_between_machines_a_robot_holds_in_time(lab: Lab, name: str, lease_s: float) -> None:
    fault, endpoint = FAULTS[name], f"tls/{lab.robot.address}:7447"
    keys: dict[str, Any] = {"tls": lab.tls("pc1"), "operators": OPERATORS, "trust_local_users": None}
    with bridge({"hand1": lab.node.socket}, endpoint=endpoint, prefix=lab.robot.prefix, **keys) as served:
        held_s = strike(lab.node, "hand1", lab.operated(served), lab.station.cable, fault, lease_s, 0.1)
    bounded(held_s, fault, lease_s)


@pytest.mark.parametrize(
    ("name", "lease_s", "cut"),
    [
        ("router killed", 5.0, ""),
        ("router stopped", 0.5, ""),
        ("router stopped", 5.0, ""),
        ("link cut", 0.5, "station"),
        ("link cut", 5.0, "robot"),
        ("link cut for 300 ms", 1.0, "robot"),
    ],
)
def test_behind_a_router_a_robot_holds_in_time(lab: Lab, name: str, lease_s: float, cut: str) -> None:
    """Whichever of the two links falls silent."""
    fault, endpoint = {**FAULTS, **ROUTER_FAULTS}[name], f"tls/{lab.hub.address}:7447"
    keys: dict[str, Any] = {"operators": OPERATORS, "trust_local_users": None}
    behind: dict[str, Any] = {"listen": None, "connect": [endpoint], "router": "hub", "tls": lab.tls("pc1")}
    with (
        router({"pc1": ["hand1"]}, endpoint, lab.hub.prefix, tls=lab.tls("hub"), **keys) as hub,
        bridge(
            {"hand1": lab.node.socket}, endpoint=endpoint, prefix=lab.robot.prefix, **keys, **behind
        ) as served,
    ):
        cable = (lab.robot if cut == "robot" else lab.station).cable
        operated = lab.operated(hub)
        held_s = strike(lab.node, "hand1", served, cable, fault, lease_s, 0.1, router=operated)
    bounded(held_s, fault, lease_s)
