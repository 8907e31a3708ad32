"""The outbox of one client."""

from __future__ import annotations

import asyncio

from contid.remote.server.outbox import MAX_FRAMES, MAX_RESPONSES, Outbox


async def test_an_outbox_keeps_the_newest_frames_and_every_answer() -> None:
    outbox = Outbox()
    for number in range(MAX_FRAMES + 5):
        outbox.put_frame(b"%d" % number)
    outbox.put(b"answer")
    assert (outbox.dropped, await outbox.get(), await outbox.get()) == (5, b"answer", b"5")
    for _ in range(MAX_RESPONSES):
        outbox.put(b"")
    assert not outbox.overflowed
    outbox.put(b"")
    assert outbox.overflowed


async def test_a_waiting_outbox_yields_to_the_loop() -> None:
    outbox = Outbox()
    waiting = asyncio.create_task(outbox.get())
    await asyncio.sleep(0)
    outbox.put(b"now")
    assert await waiting == b"now"
