"""``contid fleet ros``: telemetry of a fleet for programs of ROS 2 that use rmw_zenoh, read only.

It is an operator of the fleet that only watches, and a node of ROS 2 that only publishes. It subscribes to no
topic: a topic has no lease, so it must not move a robot.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from contid.errors import ContidError
from contid.remote.protocol.wire import Fields, decode
from contid_fleet.clocks import ClockOffset, measure_offset
from contid_fleet.net import Declared, FleetError, NetSession
from contid_fleet.operator import FleetOperator
from contid_fleet.ros.keys import RosNode, RosTopic, attachment
from contid_fleet.ros.messages import NodeMessages, RosMessage, type_hash

NODE_NAME: Final = "contid_fleet"
#: Most frames that wait to be published; beyond it the oldest is dropped.
WAITING: Final = 64
#: A node that did not answer is asked again after this time.
RETRY_S: Final = 1.0


class RosPublisher:
    """A node of ROS 2 that publishes messages; topics appear with their first message.

    Args:
        net: a session at the router of ROS 2.
        domain: ROS_DOMAIN_ID.
    """

    def __init__(self, net: NetSession, domain: int) -> None:
        self._net = net
        self._node = RosNode(domain, net.identifier, NODE_NAME)
        self._topics: dict[str, RosTopic] = {}
        self._sent: dict[str, int] = {}
        self._tokens: list[Declared] = [net.token(self._node.token())]

    def publish(self, message: RosMessage) -> None:
        """Publish one message."""
        topic = self._topics.get(message.topic)
        if topic is None:
            number, hashed = len(self._topics) + 1, type_hash(message.type_name)
            topic = RosTopic(self._node, number, message.topic, message.type_name, hashed)
            self._topics[message.topic] = topic
            self._tokens.append(self._net.token(topic.token()))
        number = self._sent[message.topic] = self._sent.get(message.topic, 0) + 1
        extra = attachment(number, time.time_ns(), topic.gid())
        self._net.put(topic.key, message.payload, attachment=extra)


class RosView:
    """Passes the telemetry of a fleet on to ROS 2. Use `run`.

    Args:
        operator: who watches.
        publisher: publisher in ROS 2.
        report: gets a message when a node appears, or cannot be shown.
    """

    def __init__(
        self, operator: FleetOperator, publisher: RosPublisher, report: Callable[[str], None]
    ) -> None:
        self._operator = operator
        self._publisher = publisher
        self._report = report
        self._frames: queue.Queue[tuple[str, bytes]] = queue.Queue(WAITING)
        self._nodes: dict[str, tuple[NodeMessages, ClockOffset]] = {}
        #: Time on the monotonic clock from which a node that did not answer may be asked again [s].
        self._retry_from_s: dict[str, float] = {}
        #: Ends the watch over the token of a node.
        self._forget: dict[str, Callable[[], None]] = {}
        operator.net.subscribe(operator.keys.telemetry("*"), self._put)

    def run(self) -> None:
        """Pass frames on until interrupted."""
        while True:
            try:
                key, line = self._frames.get(timeout=1.0)
            except queue.Empty:
                continue
            self.show(self._operator.keys.node(key), decode(line))

    def show(self, node: str, frame: Fields) -> None:
        """Publish one frame of a node; the first one asks the node what it is and for its clock."""
        known = self._nodes.get(node)
        if known is None or not known[0].describes(frame):
            known = self._known(node)
        if known is None or not known[0].describes(frame):
            return
        messages, offset = known
        # The time of day of the tick, by the clock of this machine.
        time_ns = time.time_ns() - time.monotonic_ns() + round(offset.here(frame["t_s"]) * 1e9)
        for message in messages.messages(frame, time_ns):
            self._publisher.publish(message)

    def _known(self, node: str) -> tuple[NodeMessages, ClockOffset] | None:
        if time.monotonic() < self._retry_from_s.get(node, 0.0):
            return None
        self._retry_from_s[node] = time.monotonic() + RETRY_S
        try:
            response = self._operator.ask(node, "describe", {}, RETRY_S)
            if response is None or not response.get("ok"):
                raise FleetError(f"{node}: no answer to describe")
            known = NodeMessages(node, response["result"]), measure_offset(self._operator, node)
        except ContidError as error:
            self._report(str(error))
            return None
        self._nodes[node] = known
        if (forget := self._forget.pop(node, None)) is not None:
            forget()
        # After a restart of its machine its clock counts from another time.
        self._forget[node] = self._operator.on_leave(node, lambda: self._left(node))
        self._report(
            f"{node}: {', '.join(response['result']['robots'])} (clock +-{known[1].bound_s * 1e3:.2f} ms)"
        )
        return known

    def _left(self, node: str) -> None:
        """In a thread of Zenoh."""
        self._nodes.pop(node, None)

    def _put(self, key: str, line: bytes) -> None:
        """In a thread of Zenoh."""
        while True:
            try:
                return self._frames.put_nowait((key, line))
            except queue.Full:
                with suppress(queue.Empty):  # all were published meanwhile
                    self._frames.get_nowait()
