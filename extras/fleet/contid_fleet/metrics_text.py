"""The metrics of a bridge in the text format of Prometheus (version 0.0.4).

https://prometheus.io/docs/instrumenting/exposition_formats/
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import accumulate
from typing import Any, Final, TypeAlias

from contid.control.tick.supervisor import Mode
from contid.remote.protocol.wire import Fields
from contid_fleet.clocks import NotedOffset
from contid_fleet.node import Node

CONTENT_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"

Labels: TypeAlias = Mapping[str, str]
#: Ending of the name, labels, value.
Sample: TypeAlias = tuple[str, Labels, float]


class MetricsText:
    """Families of samples, each with its help and type once."""

    def __init__(self) -> None:
        self._lines: list[str] = []

    def family(self, name: str, kind: str, help: str, samples: Iterable[Sample]) -> None:
        """Add a family; one without samples is left out."""
        lines = [f"{name}{ending}{_labels(labels)} {_value(value)}" for ending, labels, value in samples]
        if lines:
            self._lines += [f"# HELP {name} {help}", f"# TYPE {name} {kind}", *lines]

    def text(self) -> str:
        """The whole page."""
        return "\n".join(self._lines) + "\n"


def nodes_text(metrics: MetricsText, statuses: Mapping[str, Fields | None]) -> None:
    """Add what daemons report about themselves; None for a node that did not answer."""
    up = {name: status for name, status in statuses.items() if status is not None}
    metrics.family(
        "contid_up", "gauge", "1 when the daemon answered.",
        _by_node({name: float(status is not None) for name, status in statuses.items()}),
    )  # fmt: skip
    running = {name: status for name, status in up.items() if status.get("tick") is not None}
    cycles = {name: status["tick"] + 1 - status["skipped"] for name, status in running.items()}
    metrics.family("contid_ticks_total", "counter", "Ticks of the control loop.", _by_node(cycles))
    skipped = {name: status["skipped"] for name, status in running.items()}
    metrics.family("contid_ticks_skipped_total", "counter", "Ticks that never started.", _by_node(skipped))
    metrics.family(
        "contid_tick_lateness_seconds", "histogram", "How late ticks started.",
        [sample for name, status in running.items() for sample in _histogram(name, status)],
    )  # fmt: skip
    rates_hz = {name: (status.get("overload") or status)["rate_hz"] for name, status in up.items()}
    metrics.family(
        "contid_tick_rate_hertz", "gauge", "Ticks per second; under overload fewer than the file has.",
        _by_node(rates_hz),
    )  # fmt: skip
    metrics.family(
        "contid_robot_tick_seconds", "gauge", "What a tick of a robot takes, mean of the newest.",
        [
            ("", {"node": name, "robot": robot}, fields["tick_ms"] * 1e-3)
            for name, status in up.items()
            for robot, fields in status["robots"].items()
            if fields.get("tick_ms") is not None
        ],
    )  # fmt: skip
    metrics.family(
        "contid_robot_state", "gauge", "1 for the state that a robot has.",
        [
            ("", {"node": name, "robot": robot, "state": mode.name}, float(fields["state"] == mode.name))
            for name, status in up.items()
            for robot, fields in status["robots"].items()
            for mode in Mode
        ],
    )  # fmt: skip
    metrics.family(
        "contid_robot_fault", "gauge", "Number of the latched fault of a robot, 0 without one.",
        [
            ("", {"node": name, "robot": robot}, float((fields.get("fault") or {}).get("number", 0)))
            for name, status in up.items()
            for robot, fields in status["robots"].items()
        ],
    )  # fmt: skip
    metrics.family(
        "contid_bus_age_seconds", "gauge", "Age of the oldest measurement of a bus.",
        [
            ("", {"node": name, "bus": bus}, fields["age_ms"] * 1e-3)
            for name, status in up.items()
            for bus, fields in status["buses"].items()
            if fields["age_ms"] is not None
        ],
    )  # fmt: skip
    metrics.family(
        "contid_lease_held", "gauge", "1 for who holds the lease; absent when it is free.",
        [
            ("", {"node": name, "holder": lease["holder"], "by": lease.get("by") or ""}, 1.0)
            for name, status in up.items()
            if (lease := status["lease"])["holder"] is not None
        ],
    )  # fmt: skip
    clients = {name: status["clients"] for name, status in up.items()}
    metrics.family("contid_clients", "gauge", "Clients connected to the socket.", _by_node(clients))


def bridge_text(metrics: MetricsText, nodes: Mapping[str, Node]) -> None:
    """Add what the bridge counts itself."""
    metrics.family(
        "contid_fleet_requests_total", "counter", "Requests of operators by verb and result.",
        [
            ("", {"node": name, "verb": verb, "result": result}, count)
            for name, node in nodes.items()
            for (verb, result), count in sorted(node.counts.items())
        ],
    )  # fmt: skip
    metrics.family(
        "contid_fleet_telemetry_total", "counter", "Frames of telemetry that were published.",
        _by_node({name: node.published for name, node in nodes.items()}),
    )  # fmt: skip
    metrics.family(
        "contid_fleet_telemetry_dropped_total", "counter", "Frames that the bridge read too late.",
        _by_node({name: node.dropped for name, node in nodes.items()}),
    )  # fmt: skip
    metrics.family(
        "contid_fleet_round_trip_seconds", "gauge", "Time of the last answer of a daemon.",
        _by_node({name: node.round_trip_s for name, node in nodes.items()}),
    )  # fmt: skip
    noted = {name: node.noted for name, node in nodes.items() if node.noted is not None}

    def clock(value: Callable[[NotedOffset], float]) -> list[Sample]:
        return [
            ("", {"node": name, "operator": each.operator, "conductor": each.conductor}, value(each))
            for name, each in noted.items()
        ]

    metrics.family(
        "contid_fleet_clock_offset_seconds", "gauge",
        "CLOCK_MONOTONIC of the node less that of the conductor of its last run, as noted in the recording.",
        clock(lambda each: each.offset_s),
    )  # fmt: skip
    metrics.family(
        "contid_fleet_clock_bound_seconds", "gauge", "Largest error of that offset.",
        clock(lambda each: each.bound_s),
    )  # fmt: skip
    now_s = time.monotonic()
    metrics.family(
        "contid_fleet_clock_age_seconds", "gauge", "Time since that offset was noted.",
        clock(lambda each: now_s - each.noted_s),
    )  # fmt: skip


def _by_node(values: Mapping[str, float | None]) -> list[Sample]:
    """A sample per node that has a value."""
    return [("", {"node": name}, value) for name, value in values.items() if value is not None]


def _histogram(name: str, status: Fields) -> list[Sample]:
    """Cumulative buckets in seconds."""
    classes: dict[str, Any] = status["lateness_classes"]
    bounds: Sequence[float] = [*(bound * 1e-6 for bound in classes["le_us"]), math.inf]
    node = {"node": name}
    sums = list(accumulate(classes["counts"]))
    buckets: list[Sample] = [
        ("_bucket", {**node, "le": _value(bound)}, count) for bound, count in zip(bounds, sums, strict=True)
    ]
    return [*buckets, ("_sum", node, classes["sum_us"] * 1e-6), ("_count", node, sums[-1])]


def _labels(labels: Labels) -> str:
    if not labels:
        return ""
    return "{" + ",".join(f'{name}="{_escaped(value)}"' for name, value in labels.items()) + "}"


def _escaped(value: str) -> str:
    return value.replace("\\", "\\\\").replace("\n", "\\n").replace('"', '\\"')


def _value(value: float) -> str:
    if math.isinf(value):
        return "+Inf" if value > 0.0 else "-Inf"
    return f"{value:.9g}" if isinstance(value, float) and not value.is_integer() else str(int(value))
