"""The closed chains of a robot file: what the entry point ``contid.chains`` builds."""

from __future__ import annotations

from contid.control.engine.cycle import Sink
from contid.control.engine.exchange import Exchange
from contid.control.engine.robots import Robots
from contid.robot_file.chain import Chain
from contid.robot_file.load import LoadedFile
from contid_ropes.chain import ChainGuard
from contid_ropes.monitor import ChainMonitor


class FileChains:
    """See `contid.control.engine.stages.ChainGuards`."""

    def __init__(self, loaded: LoadedFile) -> None:
        robots = loaded.file.robots.items()
        self.guards = [ChainGuard(name, robot) for name, robot in robots if isinstance(robot, Chain)]

    def monitor(self, robots: Robots, exchange: Exchange, sink: Sink) -> ChainMonitor:
        """The stage of the tick."""
        return ChainMonitor(self.guards, robots, exchange, sink)
