"""Set-points that a network loses: neither they nor their answers arrive."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from contid.client import Client
from contid_fleet.fleet_address import FleetAddress
from contid_fleet.operator import FleetOperator
from tests.support.daemons import FAR, states
from tests.support.fleets import Fleet

pytestmark = [pytest.mark.process, pytest.mark.realtime]


class Lossy:
    """The network of an operator that loses the last rows; as Zenoh it ends them when their time is over."""

    def __init__(self, net: Any, lost: int) -> None:
        self._net = net
        self._lost = lost
        self._rows = 0

    def ask(
        self,
        key: str,
        payload: bytes,
        timeout_s: float,
        answered: Any,
        done: Any,
        **qos: Any,
    ) -> None:
        if key.endswith("/rows"):
            self._rows += 1
            if self._rows > self._lost:
                threading.Timer(timeout_s, done).start()
                return
        self._net.ask(key, payload, timeout_s, answered, done, **qos)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._net, name)


@pytest.mark.parametrize("arrive", [3, 19])
def test_the_end_of_a_servo_loop_whose_last_rows_are_lost_comes_within_its_lease(
    lab: Fleet, arrive: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    with FleetOperator(lab.bridge.operator("anna")) as operator:
        monkeypatch.setattr(operator, "net", Lossy(operator.net, arrive))
        with Client(FleetAddress(operator, "hand2")) as robot, lab.daemons["hand2"].client() as local:
            robot.move(FAR)
            report = robot.servo(50, lambda state: {"x_mm": 30.5, "y_mm": 85.0} if state.step < 20 else None)
            assert report.steps > 3
            assert "stopped_by" not in local.status()["lease"]
            assert states(local) == {"HOLD"}
            robot.move(FAR)
