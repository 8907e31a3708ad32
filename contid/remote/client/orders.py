"""Requests and orders of a client, as coroutines over six abstract I/O operations."""

from __future__ import annotations

import os
import sys
import time
from abc import ABC, abstractmethod
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, Self, TypeAlias

from contid.remote.client.client_protocol import RESPONSE_TIMEOUT_S, ClientProtocol, Request
from contid.remote.client.wires import Address, address_of
from contid.remote.protocol.socket_path import find
from contid.remote.protocol.wire import (
    PROTOCOL,
    Code,
    ConnectionLostError,
    Fields,
    NoDaemonError,
    RemoteError,
)

#: One robot by name, several, or None for all.
Robots: TypeAlias = str | tuple[str, ...] | list[str] | None

#: Period of pings while a client only waits; the lease lapses after two seconds.
PING_PERIOD_S: Final = 0.5
#: Period of the check whether robots are armed.
POLL_S: Final = 0.02

_NOT_ARMED_YET: Final = {"CONNECTING", "READY", "ARMING"}


class Orders(ABC):
    """A connection to a daemon.

    Args:
        path: path of the socket, or an address (``fleet:FLEET/NODE``); None for the only running daemon.
        name: name of this client in the daemon's messages.
        timeout_s: how long to wait for a response.
        valid_s: how long after they are given orders may be carried out, where the daemon is on this machine;
            None for ``timeout_s``: what has failed for its caller moves nothing later.

    Attributes:
        path: of the socket, or the address, once connected.
        hello: the daemon's greeting: protocol, version, name, number of this client (of the same protocol).
    """

    path: Path
    hello: Fields

    def __init__(
        self,
        path: str | Path | Address | None = None,
        *,
        name: str | None = None,
        timeout_s: float = RESPONSE_TIMEOUT_S,
        valid_s: float | None = None,
    ) -> None:
        self._address = address_of(path)
        self._given = None if path is None else str(path)
        self.name = name or f"{Path(sys.argv[0]).name or 'python'}[{os.getpid()}]"
        here = self._address is None
        self._protocol = ClientProtocol(
            timeout_s, (timeout_s if valid_s is None else valid_s) if here else None
        )

    # -- I/O ---------------------------------------------------------------------------------------------

    @abstractmethod
    async def _open(self, path: Path) -> None:
        """Connect; an OSError when nothing listens."""

    @abstractmethod
    async def _exchange(self, request: Request) -> Fields:
        """Send a request and wait for its result."""

    @abstractmethod
    async def _post(self, request: Request) -> None:
        """Send a request; its result is looked up later."""

    @abstractmethod
    async def _wait_notice(self, seconds: float) -> None:
        """Wait for a notice or the response to rows, at most for this time [s]."""

    @abstractmethod
    async def _sleep(self, seconds: float) -> None:
        """Wait for this time [s]."""

    @abstractmethod
    async def _disconnect(self) -> None:
        """Close the connection; idempotent."""

    # -- connection --------------------------------------------------------------------------------------

    async def connect(self) -> Self:
        """Connect; ``with`` and ``async with`` do it. To a daemon of another protocol it only gives stops.

        Raises:
            NoDaemonError: no daemon there, or several and no path.
        """
        self.path = Path(self._address.name) if self._address is not None else find(self._given)
        try:
            await self._open(self.path)
            self.hello = await self._greeted()
        except OSError as error:
            await self._disconnect()
            if isinstance(error, BlockingIOError):
                message = f"{self.path}: the daemon has not accepted the connection in time; it is overloaded"
                raise NoDaemonError(message) from error
            if isinstance(error, PermissionError):
                remedy = "join the group of its --socket-group or --watch-group"
                raise NoDaemonError(f"{self.path}: this user may not connect; {remedy}") from error
            reason = error.strerror or error
            raise NoDaemonError(f"{self.path}: no daemon listens there ({reason})") from error
        except BaseException:
            await self._disconnect()
            raise
        return self

    async def _greeted(self) -> Fields:
        """The response to ``hello``; the greeting of a daemon with another protocol, which still stops."""
        try:
            return await self.request("hello", protocol=PROTOCOL, name=self.name)
        except RemoteError:
            if not self._protocol.foreign:
                raise
            return self._protocol.greeting

    async def close(self) -> None:
        """Release the lease and disconnect; idempotent."""
        with suppress(ConnectionLostError, RemoteError):
            await self.request("release")
        await self._disconnect()

    async def request(self, verb: str, /, **fields: Any) -> Fields:
        """Send any request and wait for its result; docs/remote.md lists the verbs.

        Raises:
            RemoteError: the daemon refused.
            ConnectionLostError: the connection ended.
        """
        return await self._carry_out(self._protocol.request(verb, fields))

    async def _carry_out(self, request: Request) -> Fields:
        try:
            return await self._exchange(request)
        finally:
            self._protocol.forget(request)

    async def _listen(self) -> None:
        """Wait for a notice; a loop of these keeps the lease."""
        await self._wait_notice(PING_PERIOD_S)
        if time.monotonic() - self._protocol.requested_s > PING_PERIOD_S:
            await self.ping()

    # -- orders ------------------------------------------------------------------------------------------

    async def status(self) -> Fields:
        """Buses with the age of their data, robots with state, fault, tip and axes, and the lease."""
        return await self.request("status")

    async def describe(self) -> Fields:
        """Robots, axes, limits, and the columns of each."""
        return await self.request("describe")

    async def ping(self) -> None:
        """Keep the lease."""
        await self.request("ping")

    async def hold(self, robots: Robots = None) -> Fields:
        """Stop with limited jerk and stay; needs no lease."""
        return await self.request("hold", robots=names_of(robots))

    async def stop(self, robots: Robots = None, *, end: bool = False) -> Fields:
        """Stop by the robot file's ``stop.on_interrupt``; ``end`` also ends the daemon. Needs no lease."""
        return await self.request("stop", robots=names_of(robots), end=end or None)

    async def estop(self, robots: Robots = None) -> Fields:
        """Relax or vent now; needs no lease."""
        return await self.request("estop", robots=names_of(robots))

    async def clear_fault(self, robots: Robots = None) -> Fields:
        """Re-check all devices and leave FAULT; never moves. `resume` arms."""
        return await self.request("clear_fault", robots=names_of(robots))

    async def grip(self, share: float, robots: Robots = None) -> Fields:
        """Limit the effort to a share (0 to 1) of that of the robot file; moves and arms nothing."""
        return await self.request("grip", share=share, robots=names_of(robots))

    async def recover(self, robots: Robots = None, *, wait: bool = True, after_stop: bool = False) -> Fields:
        """Move robots that were found outside their limits inside, slowly; they hold there.

        Arguments and errors are those of `resume`.
        """
        return await self._arm("recover", robots, wait, after_stop)

    async def resume(self, robots: Robots = None, *, wait: bool = True, after_stop: bool = False) -> Fields:
        """Arm if need be and follow the previous target again; waits until the robots are armed.

        Args:
            robots: names; None for all.
            wait: return when they are armed; ``refused`` of the result has, by robot, why others are not.
            after_stop: go on although another client stopped them; for a person who has checked the robots.

        Raises:
            RemoteError: refused, or no robot could be armed.
        """
        return await self._arm("resume", robots, wait, after_stop)

    async def _arm(self, verb: str, robots: Robots, wait: bool, after_stop: bool) -> Fields:
        result = await self.request(verb, robots=names_of(robots), after_stop=after_stop or None)
        while wait and _NOT_ARMED_YET & set(result["robots"].values()):
            await self._sleep(POLL_S)
            status = await self.status()
            result["robots"] = {name: status["robots"][name]["state"] for name in result["robots"]}
        if wait and "FAULT" in result["robots"].values():
            self._refuse_faults(result, (await self.status())["robots"])
        return result

    def _refuse_faults(self, result: Fields, now: Fields) -> None:
        """Add robots that went to FAULT while they were armed to those that refused."""
        refused = result.get("refused", {})
        faults = {name: now[name].get("fault") for name in result["robots"] if name not in refused}
        faults = {name: fault for name, fault in faults.items() if fault}
        why = {
            name: f"{name}: fault {it['number']} {it['name']}, {it['what']}" for name, it in faults.items()
        }
        if why:
            result["refused"] = {**refused, **why}
        if why and result["refused"].keys() >= result["robots"].keys():
            raise RemoteError(Code.FAULT, "; ".join(result["refused"].values()), faults)

    async def wait(self, move: int) -> None:
        """Wait until a move has ended; keeps the lease meanwhile.

        Raises:
            RemoteError: it was stopped before its end.
        """
        while not self._protocol.arrived(move):
            await self._listen()

    async def acquire(self, timeout_s: float = 2.0, *, takeover: bool = False) -> Fields:
        """Acquire the lease; without a request for ``timeout_s`` it lapses and the robots hold."""
        return await self.request("acquire", timeout_s=timeout_s, takeover=takeover)

    async def release(self) -> bool:
        """Release the lease; a point in progress is still reached. True when this client held it."""
        return bool((await self.request("release"))["released"])

    async def record(self, *, end: bool = False) -> Fields:
        """Begin a recording, or end it; the daemon chooses the file, which the result names."""
        return await self.request("record", end=end)


def names_of(robots: Robots) -> list[str] | None:
    """Names as a list; None for all."""
    if robots is None:
        return None
    return [robots] if isinstance(robots, str) else list(robots)
