"""The connection of one session of an operator: the order in which requests reach the daemon."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any, cast

import pytest

from contid.remote.protocol.wire import Fields
from contid_fleet.links.operator_link import OperatorLink


class SlowDaemon:
    """Answers `status` once `answers` is set, and everything else at once."""

    open = True

    def __init__(self) -> None:
        self.answers = asyncio.Event()
        self.got: list[str] = []

    async def result(self, verb: str) -> Fields:
        await self.answers.wait()
        return {"lease": {"client": 0}}

    async def request(self, verb: str, fields: Fields) -> Fields:
        self.got.append(verb)
        return {"ok": True, "result": {}}


@pytest.mark.parametrize("verb", ["move", "resume"])
async def test_an_order_before_a_stop_is_not_sent_after_it(verb: str) -> None:
    daemon = SlowDaemon()
    link = OperatorLink(Path("none"), cast(Any, None), lambda line, is_notice: None)
    link._link = cast(Any, daemon)
    before = asyncio.create_task(link.request(verb, {}))
    await asyncio.sleep(0)
    assert (await link.request("hold", {}))["ok"]
    daemon.answers.set()
    assert (await before)["error"]["code"] == "stopped"
    assert daemon.got == ["hold"]
    assert (await link.request(verb, {}))["ok"]
    assert daemon.got == ["hold", verb]
