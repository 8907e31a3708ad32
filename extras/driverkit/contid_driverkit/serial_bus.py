"""A polled bus behind a serial port, which is found again when its adapter comes back under another name."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

from contid.errors import DeviceLostError
from contid.hal import AxisOnBus, Clock
from contid.kit.locked_port import LockedPort
from contid.kit.serial_ports import UsbIdentity, find_port, identity_of
from contid_driverkit.polled_bus import PolledBus


class SerialBus(PolledBus):
    """See `PolledBus`; a driver defines `check`, `read`, `send` and `power`.

    Args:
        name: of the bus.
        axes: on it.
        clock: for the times of samples.
        port: path or glob of the port, as in the robot file.
        baud: rate [bit/s].
        latency_s: allowance for the adapter.
        echo: the adapter returns what is sent.
    """

    def __init__(
        self, name: str, axes: Sequence[AxisOnBus], clock: Clock,
        *, port: str, baud: int, latency_s: float, echo: bool = False,
    ) -> None:  # fmt: skip
        super().__init__(name, axes, clock)
        self._pattern, self._baud, self._latency_s, self._echo = port, baud, latency_s, echo
        self._line: LockedPort | None = None
        self._adapter: UsbIdentity | None = None

    @abstractmethod
    def check(self) -> None:
        """Check that every device is there; see `PolledBus.connect`."""

    @property
    def line(self) -> LockedPort:
        """The open port.

        Raises:
            DeviceLostError: the bus is not open.
        """
        if self._line is None:
            raise DeviceLostError(self.name, "the bus is not open")
        return self._line

    def connect(self) -> None:
        """See `PolledBus.connect`."""
        path = find_port(self.name, self._pattern, self._adapter)
        self._line = LockedPort(self.name, path, self._baud, self._latency_s, echo=self._echo)
        self._line.drain()  # of answers to a process that had the port before
        self.check()
        self._adapter = identity_of(path) or self._adapter

    def disconnect(self) -> None:
        """See `PolledBus.disconnect`."""
        if self._line is not None:
            self._line.close()
            self._line = None
