"""The page of metrics: by the grammar of Prometheus, by its own parser, and against what daemons report."""

from __future__ import annotations

import math
import re
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid.client import Client, RemoteError
from contid.errors import ContidError
from contid_fleet.fleet_address import FleetAddress
from contid_fleet.metrics_server import metrics_address
from contid_fleet.metrics_text import MetricsText, nodes_text
from contid_fleet.operator import FleetOperator
from tests.support.command import contid
from tests.support.daemons import armed, daemon
from tests.support.fleets import bridge, machine_file
from tests.support.ports import free_port
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: https://prometheus.io/docs/instrumenting/exposition_formats/: a sample, its labels and its value.
SAMPLE = re.compile(
    r"(?P<name>[a-zA-Z_:][a-zA-Z0-9_:]*)"
    r"(\{(?P<labels>[a-zA-Z_][a-zA-Z0-9_]*=\"(\\.|[^\"\\])*\"(,[a-zA-Z_][a-zA-Z0-9_]*=\"(\\.|[^\"\\])*\")*)\})?"
    r" (?P<value>[-+]?(\d+(\.\d+)?(e[-+]?\d+)?|Inf)|NaN)"
)
COMMENT = re.compile(r"# (HELP [a-z_]+ .+|TYPE [a-z_]+ (counter|gauge|histogram))")


def parsed(text: str) -> dict[str, dict[frozenset[tuple[str, str]], float]]:
    """Values by name and labels, by Prometheus' own parser."""
    parser: Any = pytest.importorskip("prometheus_client.parser")
    found: dict[str, dict[frozenset[tuple[str, str]], float]] = {}
    for family in parser.text_string_to_metric_families(text):
        assert family.type in ("counter", "gauge", "histogram")
        assert family.documentation
        for sample in family.samples:
            labels = frozenset(sample.labels.items())
            assert labels not in found.setdefault(sample.name, {}), "every sample once"
            found[sample.name][labels] = sample.value
    return found


def follows_the_grammar(text: str) -> None:
    assert text.endswith("\n")
    for line in text.removesuffix("\n").split("\n"):
        assert SAMPLE.fullmatch(line) or COMMENT.fullmatch(line), line


@given(
    labels=st.dictionaries(st.sampled_from(["node", "holder", "by"]), st.text(max_size=30), max_size=3),
    value=st.floats(allow_nan=False) | st.integers(-(10**9), 10**12),
)
def test_any_label_and_value_is_read_back(labels: Mapping[str, str], value: float) -> None:
    metrics = MetricsText()
    metrics.family("contid_x", "gauge", "Some value.", [("", labels, value)])
    text = metrics.text()
    follows_the_grammar(text)
    ((found_labels, found),) = parsed(text)["contid_x"].items()
    assert dict(found_labels) == dict(labels)
    assert found == pytest.approx(value, rel=1e-8)


def test_the_page_has_what_the_daemons_report(tmp_path: Path) -> None:
    port = free_port()
    url = f"http://127.0.0.1:{port}/metrics"
    with (
        daemon(2) as one,
        one.client(name='a "quoted" name') as local,
        bridge(
            {"hand1": one.socket, "hand2": one.folder / "none"}, arguments=["--metrics", f"127.0.0.1:{port}"]
        ) as served,
        FleetOperator(served.operator()) as operator,
        Client(FleetAddress(operator, "hand1")) as robot,
    ):
        armed(local)
        for _ in range(3):
            robot.describe()
        with pytest.raises(RemoteError):
            robot.move({"f0.x_mm": 3000.0, "f0.y_mm": 85.0})
        local.acquire()
        local.hold()
        before = local.status()["tick"]
        until(lambda: "contid_tick_lateness_seconds_count" in httpx.get(url).text, "ticks were counted")
        page = httpx.get(url)
        assert page.headers["content-type"].startswith("text/plain; version=0.0.4")
        follows_the_grammar(page.text)
        found = parsed(page.text)
        hand = ("node", "hand1")
        assert found["contid_up"] == {frozenset({hand}): 1.0, frozenset({("node", "hand2")}): 0.0}
        assert found["contid_ticks_total"][frozenset({hand})] >= before
        states = {labels for labels, value in found["contid_robot_state"].items() if value}
        assert states == {frozenset({hand, ("robot", r), ("state", "HOLD")}) for r in ("f0", "f1")}
        assert set(found["contid_robot_fault"].values()) == {0.0}
        assert 0.0 <= found["contid_bus_age_seconds"][frozenset({hand, ("bus", "bus0")})] < 5.0
        assert found["contid_lease_held"] == {
            frozenset({hand, ("holder", 'a "quoted" name'), ("by", "")}): 1.0
        }
        requests = found["contid_fleet_requests_total"]
        assert requests[frozenset({hand, ("verb", "describe"), ("result", "ok")})] == 3.0
        assert requests[frozenset({hand, ("verb", "move"), ("result", "no-lease")})] == 1.0
        assert requests[frozenset({hand, ("verb", "move"), ("result", "unreachable")})] == 1.0
        assert found["contid_fleet_telemetry_total"][frozenset({hand})] > 0
        assert found["contid_fleet_round_trip_seconds"][frozenset({hand})] > 0.0
        buckets = {
            float(dict(labels)["le"]): value
            for labels, value in found["contid_tick_lateness_seconds_bucket"].items()
        }
        values = [buckets[bound] for bound in sorted(buckets)]
        assert values == sorted(values), "cumulative"
        assert math.inf in buckets
        count = found["contid_tick_lateness_seconds_count"][frozenset({hand})]
        assert values[-1] == count <= found["contid_ticks_total"][frozenset({hand})]
        again = parsed(httpx.get(url).text)
        for name in (name for name in found if name.endswith(("_total", "_count"))):
            for labels, value in found[name].items():
                assert again[name][labels] >= value, "a counter never falls"

        assert httpx.get(url, headers={"Host": "evil.example:80"}).status_code == 421
        assert httpx.get(url.removesuffix("/metrics")).status_code == 404
        assert httpx.post(url).status_code == 405
        with socket.create_connection(("127.0.0.1", port)) as slow:  # one that sends nothing is disconnected
            slow.settimeout(10.0)
            assert slow.recv(1) == b""
        path = machine_file(tmp_path, f"unixsock-stream/{tmp_path}/net", {"hand3": one.socket})
        done = contid("fleet", "serve", str(path), "--metrics", f"127.0.0.1:{port}")
        assert done.returncode == 2
        assert "cannot listen" in done.stderr


def test_the_page_has_the_clock_offset_of_the_last_run(tmp_path: Path) -> None:
    """All processes read the one CLOCK_MONOTONIC of this machine: the true offset is zero."""
    port = free_port()
    url = f"http://127.0.0.1:{port}/metrics"
    rows = tmp_path / "rows.csv"
    lines = [f"{0.01 * n:.2f},{30.0 + 10.0 * (n / 100) ** 2 * (3 - n / 50):.4f},80" for n in range(101)]
    rows.write_text("\n".join(("t_s,hand1/x_mm,hand1/y_mm", *lines)) + "\n")
    with (
        daemon() as one,
        one.client() as local,
        bridge({"hand1": one.socket}, arguments=["--metrics", f"127.0.0.1:{port}"]) as served,
    ):
        armed(local)
        local.release()
        assert "contid_fleet_clock" not in httpx.get(url).text, "absent before the first run"
        done = contid("fleet", "run", str(rows), "--file", str(served.operator_file()))
        assert done.returncode == 0, done.stderr
        page = httpx.get(url).text
        follows_the_grammar(page)
        found = parsed(page)
        ((labels, offset_s),) = found["contid_fleet_clock_offset_seconds"].items()
        boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
        assert dict(labels) == {"node": "hand1", "operator": "anna", "conductor": boot}
        bound_s = found["contid_fleet_clock_bound_seconds"][labels]
        assert abs(offset_s) <= bound_s < 1.0
        assert 0.0 <= found["contid_fleet_clock_age_seconds"][labels] < 30.0


@pytest.mark.parametrize(
    "text", ["0.0.0.0:9464", "192.168.1.10:9464", "9464", "127.0.0.1", "a:1", "127.0.0.1:0"]
)
def test_a_page_beyond_this_machine_is_refused(text: str) -> None:
    with pytest.raises(ContidError, match="loopback"):
        metrics_address(text)


def test_addresses_of_this_machine() -> None:
    assert metrics_address("127.0.0.1:9464") == ("127.0.0.1", 9464)
    assert metrics_address("[::1]:9464") == ("::1", 9464)


@pytest.mark.parametrize(("overload", "rate_hz"), [(None, 200.0), ({"rate_hz": 100.0}, 100.0)])
def test_overload_and_the_cost_of_robots_are_metrics(
    overload: dict[str, float] | None, rate_hz: float
) -> None:
    robots = {"left": {"state": "RUN", "tick_ms": 0.25}, "right": {"state": "OFF", "tick_ms": None}}
    status: dict[str, Any] = {
        "rate_hz": 200.0, "overload": overload, "robots": robots, "buses": {}, "clients": 1,
        "lease": {"holder": None},
    }  # fmt: skip
    metrics = MetricsText()
    nodes_text(metrics, {"a": status, "b": None})
    found = parsed(metrics.text())
    assert found["contid_tick_rate_hertz"] == {frozenset({("node", "a")}): rate_hz}
    assert found["contid_robot_tick_seconds"] == {frozenset({("node", "a"), ("robot", "left")}): 2.5e-4}
