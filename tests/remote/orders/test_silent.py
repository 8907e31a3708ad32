"""Which axes an order to stop may not have reached."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from contid.remote.server.served_run import ServedRun


def run(records: Iterator[int]) -> Any:
    """A run whose records are the number of its silent axes."""
    view: Any = SimpleNamespace(
        silent=lambda robots, record: {"f0": ["left"] * record} if record else {},
        configs={"f0": None},
        mode=lambda name, record: SimpleNamespace(name="OFF"),
    )

    async def confirmed(future: Any) -> Any:
        return SimpleNamespace(tick=7, record=1, refused={}, stronger={})

    return ServedRun(
        control=SimpleNamespace(newest=lambda: next(records)),
        view=view,
        pending=SimpleNamespace(confirmed=confirmed),  # type: ignore[arg-type]
        moves=None,  # type: ignore[arg-type]
        lease=None,  # type: ignore[arg-type]
        notify=lambda client, fields: None,
    )


@pytest.mark.parametrize(
    ("records", "silent"),
    [(iter([1, 1, 0]), {}), (iter([1] * 1000), {"silent": {"f0": ["left"]}})],
    ids=["answers two ticks later", "does not answer"],
)
async def test_axes_that_answer_soon_after_the_tick_are_not_silent(
    records: Iterator[int], silent: dict[str, Any]
) -> None:
    answer = await run(records).confirmed(None, None, stops=True)
    assert answer == {"tick": 7, "robots": {"f0": "OFF"}, **silent}


async def test_only_orders_to_stop_wait_for_them() -> None:
    assert "silent" not in await run(iter([])).confirmed(None, None)
