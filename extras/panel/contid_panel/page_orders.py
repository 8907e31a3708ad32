"""The orders that a page may give, and how its messages become requests to the daemon."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from typing import Final, TypeAlias

from contid.client import AsyncClient
from contid.control.engine.messages import ClearFault, Hold, Stop
from contid.control.orders import REQUESTS
from contid.remote.protocol.wire import (
    Code,
    ConnectionLostError,
    Fields,
    RemoteError,
    RequestFields,
    is_number,
)
from contid.trajectory.rows import MAX_NUMBER
from contid_panel.checks import Checks
from contid_panel.hub import Hub
from contid_panel.page_client import LEASE_TIMEOUT_S, PageClient
from contid_panel.poses import PanelPoses
from contid_panel.slow_move import slow_line

#: Orders of a read-only page: every client may stop.
READ_ONLY: Final = frozenset({"estop"})
#: Pause before the rows of a jog are sent again when the credit is spent [s], and how often they are sent.
CREDIT_PAUSE_S: Final = 0.03
CREDIT_ATTEMPTS: Final = 40
#: Least share of the full speed.
SLOWEST: Final = 0.01

Order: TypeAlias = Callable[[RequestFields], Awaitable[Fields]]
#: Sends one request over the connection of the page; returns the response.
Send: TypeAlias = Callable[[AsyncClient], Awaitable[Fields]]


class PageOrders:
    """Carries out the messages of one page.

    Attributes:
        orders: by verb.
    """

    def __init__(self, client: PageClient, hub: Hub, checks: Checks, poses: PanelPoses) -> None:
        self._client = client
        self._hub = hub
        self._checks = checks
        self._poses = poses
        # Number and columns of the stream of a jog, and the count of other orders when it began; None without
        # one. One message at a time begins or ends it.
        self._move: tuple[int, tuple[str, ...], int] | None = None
        self._others = 0
        self._stops = 0  # given by this page
        self._jogging = asyncio.Lock()
        self.orders: dict[str, Order] = {
            **{
                order.NAME: _to_robots(
                    self._stop if REQUESTS[order.NAME].stops else client.request,
                    getattr(AsyncClient, order.NAME),
                )
                for order in (Stop, Hold, ClearFault)
            },
            "estop": self._estop,
            # The page asks the person before it sends this after a stop of another client.
            "resume": _to_robots(client.request, partial(AsyncClient.resume, wait=False, after_stop=True)),
            "recover": _to_robots(client.request, partial(AsyncClient.recover, wait=False, after_stop=True)),
            "acquire": self._acquire,
            "release": self._plain("release"),
            "goto": self._goto,
            "home": self._home,
            "play": self._play,
            "pose": self._pose,
            "save_pose": self._save_pose,
            "record": self._record,
        }
        self.orders = {verb: self._other(order) for verb, order in self.orders.items()} | {
            "beat": self._plain("ping"),  # a heartbeat of the page keeps its lease
            "jog": self._jog,
            "jog_end": self._jog_end,
        }

    def _other(self, order: Order) -> Order:
        """An order after which the next row of a jog begins a stream: the page has forgotten the last one."""

        def other(request: RequestFields) -> Awaitable[Fields]:
            self._others += 1
            return order(request)

        return other

    async def _stop(self, send: Send) -> Fields:
        """A request to stop; what was ordered before it, and is not sent yet, moves nothing after it."""
        self._stops += 1
        return await self._client.stop(send)

    async def _estop(self, request: RequestFields) -> Fields:
        """Stop every robot, whatever else the message contains."""
        return await self._stop(lambda client: client.estop())

    async def _acquire(self, request: RequestFields) -> Fields:
        takeover = request.flag("takeover")
        request.end()
        return await self._client.request(lambda client: client.acquire(LEASE_TIMEOUT_S, takeover=takeover))

    def _plain(self, verb: str) -> Order:
        """The order that is a request of the socket without fields."""

        async def order(request: RequestFields) -> Fields:
            request.end()
            return await self._client.request(lambda client: client.request(verb))

        return order

    async def _goto(self, request: RequestFields) -> Fields:
        target = request.mapping("target") or {}
        share = _share(request)
        request.end()
        if not target or not all(is_number(each) and abs(each) <= MAX_NUMBER for each in target.values()):
            message = f"target: columns with numbers up to {MAX_NUMBER:g} are expected, such as x_mm: 40"
            raise RemoteError(Code.BAD_REQUEST, message)
        return await self._go(target, share)

    async def _home(self, request: RequestFields) -> Fields:
        """Go to the rest pose of the robot file."""
        robots, share = request.names("robots"), _share(request)
        request.end()
        rest = self._hub.rest
        for name in robots or rest:
            if name not in rest:
                raise RemoteError(Code.UNKNOWN_ROBOT, f"no rest pose of {name[:40]!r} is known here")
        return await self._go({k: v for name in robots or rest for k, v in rest[name].items()}, share)

    async def _jog(self, request: RequestFields) -> Fields:
        """Follow a row; a first row, one of other columns, or one after another order begins a stream.

        A tip that leads out of reach goes along its edge, as by the keys of a terminal.
        """
        columns, row = request.names("columns"), request.rows("rows")
        others, stops = self._others, self._stops
        request.end()
        if not columns or any(name.endswith("t_s") for name in columns):
            raise RemoteError(Code.BAD_REQUEST, "columns: names of columns without t_s are expected")

        async def jog(client: AsyncClient) -> Fields:
            if self._move is None or self._move[1:] != (columns, others):
                self._move = None
                await self._check_begin(client, stops)
                begun = await client.request("move", columns=list(columns), nearest=True)
                self._move = int(begun["move"]), columns, others
            return await self._rows(client, self._move[0], row)

        async with self._jogging:
            return await self._moving(jog)

    async def _rows(self, client: AsyncClient, move: int, rows: list[list[float]]) -> Fields:
        """Send rows of a stream, several times while the daemon grants no credit."""
        for _ in range(CREDIT_ATTEMPTS):
            try:
                return await client.request("rows", move=move, rows=rows)
            except RemoteError as error:
                if error.code == Code.REFUSED:  # the stream ended: a stop, or a takeover
                    self._move = None
                if error.code != Code.NO_CREDIT:
                    raise
            await asyncio.sleep(CREDIT_PAUSE_S)
        raise RemoteError(Code.NO_CREDIT, "the daemon takes no further row")

    async def _jog_end(self, request: RequestFields) -> Fields:
        """End the stream: the robot goes to its last row and holds there."""
        request.end()

        async def end(client: AsyncClient) -> Fields:
            move, self._move = self._move, None
            return {} if move is None else await client.request("end", move=move[0])

        async with self._jogging:
            return await self._moving(end)

    async def _play(self, request: RequestFields) -> Fields:
        """Play a trajectory that was checked and shown before."""
        checked, stops = self._checks.get(request.text("check", "")), self._stops
        request.end()

        async def play(client: AsyncClient) -> Fields:
            await self._check_begin(client, stops)
            return {"refused": await client.stream(checked.columns, checked.rows, wait=False)}

        return await self._moving(play)

    async def _pose(self, request: RequestFields) -> Fields:
        """Go to a named pose."""
        target, share = self._poses.target(request.text("name", "")), _share(request)
        request.end()
        return {**await self._go(target, share), "target": dict(target)}

    async def _go(self, target: Mapping[str, float], share: float) -> Fields:
        """Go to a target, slower than the robot file allows where ``share`` is below 1."""
        stops = self._stops

        async def go(client: AsyncClient) -> Fields:
            await self._check_begin(client, stops)
            if share >= 1.0:
                return {"move": await client.move(target, wait=False)}
            present, rates = self._hub.present(), self._hub.rates
            missing = [column for column in target if column not in present or column not in rates]
            if missing:
                raise RemoteError(
                    Code.BAD_TARGET,
                    f"{missing[0][:40]}: no slower way is known from where it is; set the speed to 100 %",
                )
            line = slow_line(present, target, rates, share)
            return {"refused": await client.stream(line.columns, line.rows, wait=False)}

        return await self._moving(go)

    async def _save_pose(self, request: RequestFields) -> Fields:
        """Save where robots are under a name."""
        name, replace = request.text("name", ""), request.flag("replace")
        robots = request.names("robots")
        request.end()

        async def save(client: AsyncClient) -> Fields:
            await _require_lease(client)
            return await self._poses.save(name, robots, replace)

        return await self._client.request(save)

    async def _record(self, request: RequestFields) -> Fields:
        """Begin or end a recording; the daemon chooses its file."""
        end = request.flag("end")
        request.end()
        return await self._client.request(lambda client: client.record(end=end))

    async def _check_begin(self, client: AsyncClient, stops: int) -> None:
        """Refuse to begin a motion without the lease, or one that this page has stopped meanwhile.

        Args:
            client: the connection.
            stops: how many this page had given when the motion was ordered.
        """
        await _require_lease(client)
        if self._stops != stops:
            message = "this page stopped the robots before the motion began; it is not carried out"
            raise RemoteError(Code.STOPPED, message)

    async def _moving(self, send: Send) -> Fields:
        """A request that moves; a stream does not survive its connection."""
        try:
            return await self._client.request(send)
        except ConnectionLostError:
            self._move = None
            raise


async def _require_lease(client: AsyncClient) -> None:
    """Refuse to begin a motion without the lease: at the daemon, a move acquires a free one by itself.

    A page that was frozen sends its waiting messages when it goes on, and its lease has lapsed meanwhile.
    """
    lease = (await client.status())["lease"]
    if lease.get("client") != client.hello["client"]:
        raise RemoteError(Code.LEASE_HELD, "this page does not hold the lease; take it first")


def _share(request: RequestFields) -> float:
    """Share of the full speed, 1 when absent."""
    return request.number("share", 1.0, SLOWEST, 1.0)


def _to_robots(
    make: Callable[[Send], Awaitable[Fields]],
    order: Callable[[AsyncClient, tuple[str, ...] | None], Awaitable[Fields]],
) -> Order:
    """An order to the robots that the page names, or to all; ``make`` makes the request."""

    async def to_robots(request: RequestFields) -> Fields:
        robots = request.names("robots")
        request.end()
        return await make(lambda client: order(client, robots))

    return to_robots
