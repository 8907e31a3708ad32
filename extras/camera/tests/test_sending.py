"""Refusals of measured tips: each reason is named once for each robot, and nothing else ends silently."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import cast

import pytest

from contid.client import Client, Code, RemoteError
from contid_camera.sending import SentTip, TipSender

TIP = cast(SentTip, SimpleNamespace(time_s=1.0, tip_m=(0.01, 0.02, 0.3), direction=None))


class RefusingDaemon:
    """Refuses every tip, with the distance in the message, as the daemon does."""

    def __init__(self) -> None:
        self.code, self.sent = Code.BAD_MEASUREMENT, 0

    def _refusal(self, robot: str) -> RemoteError:
        self.sent += 1
        return RemoteError(
            self.code, f"{robot}: a tip {300.0 + 0.1 * self.sent:.6g} mm from the base is not its"
        )

    def measure(self, tip_mm: Sequence[float], *, robot: str, time_s: float, direction: None) -> None:
        raise self._refusal(robot)

    def track(
        self, tip_mm: Sequence[float], time_s: float, *, robot: str, direction: None
    ) -> list[RemoteError]:
        return [self._refusal(robot)]


def test_each_robot_has_its_reason_named_once() -> None:
    """Robots that differ by a digit, and one whose distance changes: `arm2` was taken for `arm1` again."""
    named: list[str] = []
    sender = TipSender(cast(Client, RefusingDaemon()), named.append)
    for robot in ("arm1", "arm1", "arm2", "arm2", "arm1"):
        sender.send(TIP, robot)
    assert [message.partition(":")[0] for message in named] == ["arm1", "arm2"]


def test_another_refusal_than_of_a_measurement_ends_the_tracker() -> None:
    daemon = RefusingDaemon()
    sender = TipSender(cast(Client, daemon), lambda message: None)
    sender.send(TIP, "arm1")
    daemon.code = Code.TRACKER_HELD
    for robot in ("arm1", "arm2"):
        with pytest.raises(RemoteError, match=robot):
            sender.send(TIP, robot)
