"""The serial kit on a pseudo terminal: echo, leftovers, the latency timer, and the end of an adapter."""

from __future__ import annotations

import os
import select
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from contid.errors import DeviceLostError
from contid_driverkit import LockedPort, PseudoPort, latency_timer, port_checks

REQUEST = bytes.fromhex("ff ff 01 02 01 fb")
ANSWER = bytes.fromhex("ff ff 01 02 00 fc")


@pytest.fixture
def adapter(tmp_path: Path) -> Iterator[PseudoPort]:
    port = PseudoPort(tmp_path / "adapter")
    port.plug()
    yield port
    port.unplug()


def opened(adapter: PseudoPort, *, echo: bool = False) -> LockedPort:
    return LockedPort("bus", adapter.name, 1_000_000, echo=echo)


def sent(adapter: PseudoPort) -> bytes:
    assert select.select([adapter.descriptor], [], [], 1.0)[0]
    return adapter.read()


def soon() -> float:
    return time.monotonic() + 0.2


@pytest.mark.parametrize("cuts", [[6], [1, 5, 6], [2, 8], [12]])
def test_the_echo_of_a_request_is_left_out_however_the_bytes_arrive(
    adapter: PseudoPort, cuts: list[int]
) -> None:
    port, wire, received = opened(adapter, echo=True), REQUEST + ANSWER, b""
    port.send(REQUEST)
    assert sent(adapter) == REQUEST
    for begin, end in zip([0, *cuts], [*cuts, len(wire)], strict=True):
        adapter.write(wire[begin:end])
        while received != wire[6:end] and (data := port.receive(soon())):
            received += data
    port.close()
    assert received == ANSWER


def test_an_answer_that_equals_its_request_is_kept(adapter: PseudoPort) -> None:
    """The status of a Feetech servo with a low voltage is, byte for byte, the ping that it answers."""
    port = opened(adapter, echo=True)
    port.send(REQUEST)
    adapter.write(REQUEST + REQUEST)
    assert port.receive(soon()) == REQUEST
    port.close()


def test_without_an_echo_nothing_is_left_out(adapter: PseudoPort) -> None:
    port = opened(adapter)
    port.send(REQUEST)
    adapter.write(REQUEST)
    assert port.receive(soon()) == REQUEST
    port.close()


def test_a_flush_ends_the_wait_for_an_echo_that_never_came(adapter: PseudoPort) -> None:
    port = opened(adapter, echo=True)
    port.send(REQUEST)
    port.flush()
    adapter.write(REQUEST)
    assert port.receive(soon()) == REQUEST
    port.close()


def test_a_pulled_adapter_is_lost_at_once_and_the_emulator_sees_the_rate(adapter: PseudoPort) -> None:
    port = opened(adapter)
    assert adapter.rate() == 1_000_000
    adapter.unplug()
    with pytest.raises(DeviceLostError, match="plug it in again"):
        port.receive(time.monotonic() + 5.0)
    port.close()
    assert not os.path.lexists(adapter.name)


@pytest.mark.parametrize(("value", "ok"), [("1", True), ("16", False), (None, True)])
def test_the_latency_timer_of_an_adapter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, value: str | None, ok: bool
) -> None:
    if value is not None:
        (tmp_path / "sys/class/tty/ttyUSB0/device").mkdir(parents=True)
        (tmp_path / "sys/class/tty/ttyUSB0/device/latency_timer").write_text(value)
    monkeypatch.setattr(port_checks, "TTYS", tmp_path / "sys/class/tty")
    found = latency_timer("servos", "/dev/ttyUSB0", "install the rule")
    assert found.ok == ok
    assert ("echo 1 | sudo tee" in found.remedy) != ok
