"""The time of an exchange: bytes counted from the stock SDK's packets and the emulated servos' answers."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from dynamixel_sdk import Protocol2PacketHandler

from contid.robot_file.tick_rate import highest_rate_hz
from contid_drivers.dynamixel import cycle_time
from contid_drivers.dynamixel.exchange.block import INDIRECT
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions
from contid_drivers.dynamixel.packets import sync_read, take
from contid_emulate.dynamixel import Servo
from contid_emulate.dynamixel.replies import answers


class Wire:
    """A port of the stock SDK that only counts."""

    is_using = False

    def __init__(self) -> None:
        self.written = 0

    def clearPort(self) -> None:  # name of the SDK
        """Nothing was received."""

    def writePort(self, packet: list[int]) -> int:  # name of the SDK
        self.written += len(packet)
        return len(packet)

    def setPacketTimeout(self, length: int) -> None:  # name of the SDK
        """No answer is awaited."""


def stock_bytes(ids: list[int], size: int) -> int:
    """Bytes of the instructions of one exchange as the stock SDK writes them."""
    wire, sdk = Wire(), Protocol2PacketHandler()
    goals = [byte for device in ids for byte in (device, 0, 0, 0, 0)]
    sdk.syncWriteTxOnly(wire, 116, 4, goals, len(goals))
    sdk.syncReadTx(wire, INDIRECT.address, size, ids, len(ids), False)
    return wire.written


@pytest.mark.parametrize("fast", [False, True])
@pytest.mark.parametrize("count", [1, 4, 16])
def test_bytes_are_those_of_the_stock_sdk_and_of_the_answers(count: int, fast: bool) -> None:
    ids = list(range(1, count + 1))
    packet = take(bytearray(sync_read(INDIRECT.address, INDIRECT.full, ids, fast)))
    assert packet is not None
    replies = answers(packet, [Servo(device) for device in ids], 1e-5)
    expected = stock_bytes(ids, INDIRECT.full) + sum(len(reply.wire) for reply in replies)
    assert cycle_time.bytes_on_wire(ids, INDIRECT.full, fast) == expected


def test_baud_delay_and_adapter_are_counted() -> None:
    ids = [1, 2, 3, 4]
    axes = [DynamixelAxisOptions(id=device) for device in ids]
    size = cycle_time.bytes_on_wire(ids, INDIRECT.full, fast=False)
    options = DynamixelBusOptions(
        port="x", baud=57600, return_delay_us=500, usb_latency_ms=16, fast_read="off"
    )
    time = cycle_time.exchange_time(options, axes)
    assert time.least_s == pytest.approx(size * 10 / 57600 + 4 * 500e-6)
    assert time.most_s == pytest.approx(time.least_s + 0.016)
    fast = cycle_time.exchange_time(options.model_copy(update={"fast_read": "auto"}), axes)
    assert fast.least_s < time.least_s
    assert fast.most_s == time.most_s


def test_models_with_indirect_data_at_two_addresses_may_need_the_plain_block() -> None:
    options = DynamixelBusOptions(port="x", fast_read="off")

    def wire_s(*models: str) -> tuple[float, float]:
        axes = [
            DynamixelAxisOptions.model_validate({"id": i, "model": each}) for i, each in enumerate(models)
        ]
        time = cycle_time.exchange_time(options, axes)
        return time.least_s, time.most_s - options.usb_latency_ms / 1e3

    lean, plain = (cycle_time.bytes_on_wire([0, 1], size, fast=False) * 1e-5 for size in (INDIRECT.full, 49))
    assert wire_s("xl330-m288", "xc330-m288") == pytest.approx((lean, lean))
    assert wire_s("xm430-w350", "xl430-w250") == pytest.approx((lean, lean))
    assert wire_s("xl330-m288", "xm430-w350") == pytest.approx((lean, plain))
    assert wire_s("xh430-v350", "xm430-w350") == pytest.approx((plain, plain))


def test_the_table_of_rates_in_the_docs_is_what_check_computes() -> None:
    page = Path(__file__).parents[3] / "docs" / "devices" / "dynamixel.md"
    head, _, *rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in page.read_text().split("## How fast")[1].split("\n\n| ")[1].split("\n\n")[0].splitlines()
    ]
    counts = [int(cell.split()[0]) for cell in head[1:]]
    assert len(rows) == 6
    for baud, *cells in rows:
        options = DynamixelBusOptions(port="x", baud=int(baud.replace(" ", "")))  # type: ignore[arg-type]  # pydantic checks the rate
        for count, cell in zip(counts, cells, strict=True):
            axes = [DynamixelAxisOptions(id=i) for i in range(count)]
            time = cycle_time.exchange_time(options, axes)
            fast_hz = math.floor(1.0 / time.least_s)
            assert cell == f"{highest_rate_hz(time):.0f}; {fast_hz}", (baud, count)
