"""The socket of a command without a daemon: one order to stop is one interrupt, and every one is answered."""

from __future__ import annotations

import signal
import time
from pathlib import Path
from types import FrameType

import pytest

from contid.remote.client.sync_client import Client
from contid.remote.protocol.wire import RemoteError
from contid_devices.homing import stop_server
from contid_devices.homing.stop_server import StopServer


def test_devices_that_do_not_come_to_rest_are_stated_and_further_stops_obeyed(
    own_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own_folder.chmod(0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(own_folder))
    monkeypatch.setattr(stop_server, "_REST_TIMEOUT_S", 0.05)
    interrupts: list[int] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        interrupts.append(number)

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        with (
            StopServer("finger.yaml", "homing"),
            Client(own_folder / "contid" / "finger.sock", timeout_s=1.0) as client,
        ):
            for count in (1, 2):
                with pytest.raises(RemoteError, match="have not come to rest"):
                    client.estop()
                time.sleep(0.01)
                assert len(interrupts) == count
            with pytest.raises(RemoteError, match="only hold, stop, estop"):
                client.status()
    finally:
        signal.signal(signal.SIGINT, before)
