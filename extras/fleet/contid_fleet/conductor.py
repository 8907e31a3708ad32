"""A common start of several nodes: all of them begin at one time, or none does.

    leases -> rows, checked everywhere -> first row, wait there -> clocks -> start at T -> end

Until T every step happens at all nodes before the next one begins; what fails at one node makes all hold.
Everything runs in one event loop that also keeps the leases: if this program stands still, they lapse.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Mapping
from contextlib import AsyncExitStack, suppress
from pathlib import Path
from typing import Any, Final

from contid.client import AsyncClient
from contid.errors import ContidError
from contid.remote.protocol.wire import Fields
from contid_fleet.clocks import ClockOffset, measure_offset
from contid_fleet.common_trajectory import NodeRows
from contid_fleet.fleet_address import FleetAddress
from contid_fleet.net import FleetError
from contid_fleet.operator import FleetOperator
from contid_fleet.run_report import FleetRunReport, NodeStart, OnOne

#: How far ahead a start lies: a time, and a multiple of the largest bound of a clock.
LEAD_S: Final = 0.5
LEAD_BOUNDS: Final = 10.0
#: Every node must have confirmed the start this long before it, else all hold.
CONFIRMED_S: Final = 0.1
#: Largest bound of an offset with which a start is ordered, and attempts to measure it.
MAX_BOUND_S: Final = 0.002
ATTEMPTS: Final = 5
#: Longest way to the first row.
APPROACH_TIMEOUT_S: Final = 120.0
POLL_S: Final = 0.1
#: Offsets are measured and noted so often.
NOTE_PERIOD_S: Final = 10.0
#: Names the boot from which the clock of this machine counts.
BOOT: Final = Path("/proc/sys/kernel/random/boot_id")
#: Pings in one lease.
PINGS_PER_LEASE: Final = 4.0


async def conduct(
    operator: FleetOperator,
    parts: Mapping[str, NodeRows],
    *,
    lease_s: float = 1.0,
    takeover: bool = False,
    on_one: OnOne = OnOne.HOLD_ALL,
    progress: Callable[[str], object] = lambda step: None,
) -> FleetRunReport:
    """Run a common trajectory; on any error before the start all robots hold.

    Raises:
        ContidError: a node is missing, refused, or did not arrive; the message names it.
    """
    async with AsyncExitStack() as stack:
        clients = {
            name: await stack.enter_async_context(AsyncClient(FleetAddress(operator, name), name="fleet run"))
            for name in sorted(parts)
        }
        conductor = _Conductor(operator, clients, parts, lease_s, progress)
        try:
            return await conductor.run(takeover, on_one)
        except BaseException:
            await asyncio.shield(conductor.hold_all())
            raise


class _Conductor:
    """One common run."""

    def __init__(
        self,
        operator: FleetOperator,
        clients: Mapping[str, AsyncClient],
        parts: Mapping[str, NodeRows],
        lease_s: float,
        progress: Callable[[str], object],
    ) -> None:
        self._operator = operator
        self._clients = clients
        self._parts = parts
        self._lease_s = lease_s
        self._progress = progress
        self._moves: dict[str, int] = {}
        self._experiment = f"{time.strftime('%Y%m%d-%H%M%S')}-{operator.origin.session[:4]}"
        self._moving = False

    async def run(self, takeover: bool, on_one: OnOne) -> FleetRunReport:
        self._progress("leases")
        await self._each(
            "acquire", lambda name: self._clients[name].acquire(self._lease_s, takeover=takeover)
        )
        pinging = asyncio.create_task(self._keep_leases())
        try:
            described = await self._each("describe", lambda name: self._clients[name].describe())
            tick_s = max(1.0 / float(fields["rate_hz"]) for fields in described.values())
            self._progress("rows are sent and checked")
            self._moves = await self._each("check", self._load)
            self._progress("to the first row")
            self._moving = True
            await self._each("first row", self._approach)
            offsets = await self._offsets()
            at_s = await self._start(offsets)
            self._progress("started")
            return await self._follow(at_s, offsets, tick_s, on_one)
        finally:
            pinging.cancel()

    async def hold_all(self) -> None:
        """Hold every node that may move; leases end with the connections."""
        if self._moving:
            await asyncio.gather(*(self._hold(name) for name in self._clients))

    async def _hold(self, name: str) -> None:
        with suppress(ContidError, TimeoutError):
            async with asyncio.timeout(2.0):
                await self._clients[name].hold()

    async def _keep_leases(self) -> None:
        """Ping in this loop, not in a thread: it stops with the program.

        Each node by itself: the pings of the others do not wait for one that no longer answers.
        """
        await asyncio.gather(*map(self._keep_lease, self._clients.values()))

    async def _keep_lease(self, client: AsyncClient) -> None:
        while True:
            await asyncio.sleep(self._lease_s / PINGS_PER_LEASE)
            await asyncio.gather(client.ping(), return_exceptions=True)  # what failed, the step notices

    async def _each(self, step: str, do: Callable[[str], Awaitable[Any]]) -> dict[str, Any]:
        """Do a step at every node at once.

        Raises:
            ContidError: with what every node that refused answered.
        """
        names = tuple(self._clients)
        found = await asyncio.gather(*(do(name) for name in names), return_exceptions=True)
        failed = {
            name: each for name, each in zip(names, found, strict=True) if isinstance(each, BaseException)
        }
        for each in failed.values():
            if not isinstance(each, ContidError | TimeoutError):
                raise each
        if failed:
            listed = "\n".join(f"{name}: {step}: {error or 'no answer'}" for name, error in failed.items())
            raise ContidError(f"{listed}\nnothing began" + ("; all nodes hold" if self._moving else ""))
        return dict(zip(names, found, strict=True))

    async def _load(self, name: str) -> int:
        part = self._parts[name]
        return await self._clients[name].load(part.columns, part.rows)

    async def _approach(self, name: str) -> None:
        """Go to the first row, and wait until every robot is there."""
        client = self._clients[name]
        robots = (await client.start(self._moves[name]))["robots"]
        deadline_s = time.monotonic() + APPROACH_TIMEOUT_S
        while True:
            status = await client.status()
            states = {robot: status["robots"][robot]["state"] for robot in robots}
            if {*states.values()} == {"RUN"}:
                return
            if lost := {robot: state for robot, state in states.items() if state not in ("RUN", "APPROACH")}:
                raise FleetError(", ".join(f"{robot} is {state}" for robot, state in lost.items()))
            if time.monotonic() > deadline_s:
                raise FleetError(f"not at the first row within {APPROACH_TIMEOUT_S:g} s")
            await asyncio.sleep(POLL_S)

    async def _offsets(self) -> dict[str, ClockOffset]:
        """The clocks of all nodes.

        Raises:
            FleetError: a bound is too large for a common start.
        """
        offsets = {}
        for name in self._clients:
            for _ in range(ATTEMPTS):
                offset = await asyncio.to_thread(measure_offset, self._operator, name)
                if offset.bound_s <= MAX_BOUND_S:
                    break
            else:
                raise FleetError(
                    f"{name}: its clock is known to {offset.bound_s * 1e3:.1f} ms only, and a common start "
                    f"needs {MAX_BOUND_S * 1e3:g} ms: the link is too slow; nothing began, all nodes hold"
                )
            offsets[name] = offset
        return offsets

    async def _start(self, offsets: Mapping[str, ClockOffset]) -> float:
        """Order the start; returns its time by the clock of this machine.

        Raises:
            ContidError: a node did not confirm in time; all hold before it.
        """
        largest_s = max(offset.bound_s for offset in offsets.values())
        # Before the time is chosen: what many notes take is not taken from the confirmation.
        await asyncio.gather(*(self._note(name, offset, "start") for name, offset in offsets.items()))
        at_s = time.monotonic() + max(LEAD_S, LEAD_BOUNDS * largest_s)

        async def order(name: str) -> Fields:
            async with asyncio.timeout(at_s - CONFIRMED_S - time.monotonic()):
                return await self._clients[name].start(self._moves[name], offsets[name].there(at_s))

        await self._each("start", order)
        return at_s

    async def _note(self, name: str, offset: ClockOffset, message: str) -> None:
        """Relate the clock of a node to that of this machine in its recording."""
        now_s = time.monotonic()
        with suppress(ContidError):
            await self._clients[name].request(
                "note",
                experiment=self._experiment,
                node=name,
                conductor=BOOT.read_text().strip(),
                at_s=offset.there(now_s),
                offset_s=offset.offset_s,
                bound_s=offset.bound_s,
                wall_s=time.time() - now_s,
                message=message,
            )

    async def _keep_notes(self) -> None:
        """Measure and note the offsets again from time to time: clocks drift."""
        while True:
            await asyncio.sleep(NOTE_PERIOD_S)
            await self._note_all("running")

    async def _note_all(self, message: str) -> None:
        for name in self._clients:
            with suppress(ContidError):
                offset = await asyncio.to_thread(measure_offset, self._operator, name)
                await self._note(name, offset, message)

    async def _follow(
        self, at_s: float, offsets: Mapping[str, ClockOffset], tick_s: float, on_one: OnOne
    ) -> FleetRunReport:
        """Wait until every node has ended."""
        begun: dict[str, Fields] = {}
        errors: dict[str, str] = {}

        async def follow(name: str) -> None:
            client, move = self._clients[name], self._moves[name]
            try:
                begun[name] = await client.started(move)
                await client.wait(move)
            except ContidError as error:
                errors[name] = str(error)
                if on_one is OnOne.HOLD_ALL:
                    await asyncio.gather(
                        *(self._hold(other) for other in self._clients if other not in errors)
                    )

        noting = asyncio.create_task(self._keep_notes())
        try:
            await asyncio.gather(*(follow(name) for name in self._clients))
        finally:
            noting.cancel()
        await self._note_all("end")
        nodes = {}
        for name, offset in offsets.items():
            start = begun.get(name, {})
            late_s = offset.here(start["began_s"]) - at_s if "began_s" in start else None
            nodes[name] = NodeStart(start.get("tick"), late_s, offset.bound_s, errors.get(name, ""))
        rows = next(iter(self._parts.values())).rows
        return FleetRunReport(self._experiment, nodes, tick_s, rows[-1][0] - rows[0][0])
