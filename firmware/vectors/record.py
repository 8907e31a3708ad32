"""Write vectors.txt anew: ``python firmware/vectors/record.py`` from the top of a checkout.

Frames come from Python's own CRC and COBS. Answers come from the core built for this computer; a change in
the file after recording is a change of the protocol or of a law, and is read as one in the review.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from contid.hal import AxisOnBus
from contid_devices.due.firmware_build import build_host
from contid_drivers.due import frames, messages, wiring
from contid_drivers.due.codes import PROTOCOL_VERSION, RestCode, Type
from contid_drivers.due.options import DueAxisOptions, DueBusOptions

HERE = Path(__file__).parent
PAYLOADS = [b"\x01", b"\0", b"\0\0\0", bytes(range(1, 255)), bytes(range(256)), b"\x55" * 253, b"\x55" * 254,
            b"\x55" * 640, b"\0" * 300, b"\x01\x01\x00"]  # fmt: skip
#: Places in the body of a configure message: CRC (2 bytes), role, watchdog (2 bytes), number of channels,
#: then the block of each channel.
ROLE_AT, COUNT_AT, CHANNEL_AT = 2, 5, 6
START_STATE_AT = CHANNEL_AT + 2
HOMING = {"direction": -1, "speed_deg_s": 90, "timeout_s": 5}


def config(role: str, *axes: dict[str, object]) -> tuple[bytes, int]:
    """The body of a configure message, and the configuration's CRC."""
    on_bus = [
        AxisOnBus(
            str(a["channel"]), DueAxisOptions.model_validate(a), (-10.0, 60.0) if role == "motor" else None
        )
        for a in axes
    ]
    blob = wiring.board_config("b", DueBusOptions(port="x", role=role), on_bus)  # type: ignore[arg-type]
    return wiring.config_body(blob), frames.crc16(blob)


def motor_dialogue() -> Iterator[tuple[str, ...]]:
    """Every message of a motor board, what it refuses, a motion, a watchdog."""
    body, crc = config(
        "motor",
        {"channel": "m0"},
        {"channel": "m3", "on_watchdog": "coast", "start_state": "coast", "homing": HOMING},
    )
    yield ("board", "motor")
    yield ("#", "hello before and after; nothing is configured")
    yield ("tick", "1")
    yield ask(Type.HELLO)
    yield ask(Type.DEMAND, messages.demand(0, 0, {}))
    yield ask(Type.ARM, messages.mask_body(0, [0]))
    yield ("#", "unknown message, wrong version, wrong length")
    yield (
        ">",
        messages.request(Type.HELLO, 9)
        .replace(bytes([PROTOCOL_VERSION, 1]), bytes([PROTOCOL_VERSION, 0x42]), 1)
        .hex(),
    )
    yield (">", b"\x02\x01\x0a".hex())
    yield ask(Type.HELLO, b"\0")
    yield (">", bytes([PROTOCOL_VERSION]).hex())
    yield (
        "#",
        "configure: wrong CRC; safe state is not start state; wrong role; cut short; then as it should be",
    )
    yield ask(Type.CONFIGURE, bytes([body[0] ^ 1]) + body[1:])
    yield ask(Type.CONFIGURE, patched(body, START_STATE_AT, 1))
    yield ask(Type.CONFIGURE, patched(body, ROLE_AT, 1))
    yield ask(Type.CONFIGURE, wiring.config_body(body[2:-1]))
    yield ask(Type.CONFIGURE, patched(body, COUNT_AT, 7))
    yield ask(Type.CONFIGURE, body)
    yield ask(Type.CONFIGURE, body)
    yield ask(Type.HELLO)
    yield (
        "#",
        "arming: wrong CRC, a channel that is not configured, one that is not homed; then one that may",
    )
    yield ask(Type.ARM, messages.mask_body(crc ^ 1, [0]))
    yield ask(Type.ARM, messages.mask_body(crc, [0, 1]))
    yield ask(Type.ARM, messages.mask_body(crc, [3]))
    yield ask(Type.ARM, messages.mask_body(crc, [0]))
    yield ("#", "a stream of demands that the shaft follows, then a stale one, then silence for the watchdog")
    for i in range(12):
        yield ("count", "0", str(2 * i))
        yield ("tick", "5")
        yield ask(Type.DEMAND, messages.demand(crc, 1 + 5 * i, {0: 2 * i, 3: 5}))
    yield ask(Type.DEMAND, messages.demand(crc, 1000, {0: 0}))
    yield ("tick", "99")
    yield ask(Type.CONFIGURE, config("motor", {"channel": "m1"})[0])
    yield ("tick", "1")
    yield ask(Type.DEMAND, messages.demand(crc, 100, {0: 300}))
    yield ask(Type.ARM, messages.mask_body(crc, [0]))
    yield ask(Type.CLEAR, messages.mask_body(crc, [0]))
    yield ("#", "homing: not on a channel without it; started; stopped with each rest")
    yield ask(Type.HOME, messages.mask_body(crc, [0]))
    yield ask(Type.HOME, messages.mask_body(crc, [3]))
    yield ("tick", "20")
    yield ask(Type.DEMAND, messages.demand(crc, 160, {}))
    for rest in RestCode:
        yield ask(Type.STOP, messages.stop([0, 3], rest))
        yield ("tick", "3")
    yield ask(Type.STOP, b"\x01\x09")
    yield ask(Type.STOP, b"\xff\x00")
    yield ("#", "a step of 1000 counts with the shaft standing: stall, reason 2")
    yield ask(Type.ARM, messages.mask_body(crc, [0]))
    for i in range(24):
        yield ("tick", "10")
        yield ask(Type.DEMAND, messages.demand(crc, 175 + 10 * i, {0: 1100}))
    yield ("#", "a position declared lost, refused for arming, then parked")
    yield ask(Type.CLEAR, messages.mask_body(crc, [0]))
    yield ask(Type.PARK, messages.park(crc, [0], parked=False))
    yield ask(Type.ARM, messages.mask_body(crc, [0]))
    yield ask(Type.PARK, messages.mask_body(crc, [0]) + b"\x02")
    yield ask(Type.PARK, messages.park(crc, [0], parked=True))
    yield ask(Type.ARM, messages.mask_body(crc, [0]))
    yield ask(Type.PARK, messages.park(crc, [0], parked=True))
    yield (
        "#",
        "a pulse: too strong, too long, while armed; then one, its trace under way and over; the order again",
    )
    yield ask(Type.TRACE, messages.trace(crc))
    yield ask(Type.PULSE, messages.pulse(crc, 415, 0, 6554, 30))
    yield ask(Type.PULSE, messages.pulse(crc, 415, 0, 6553, 31))
    yield ask(Type.PULSE, messages.pulse(crc, 415, 3, 6553, 30))
    yield ask(Type.STOP, messages.stop([0, 3], RestCode.RELAX))
    yield ask(Type.PULSE, messages.pulse(crc, 415, 3, 6553, 30))
    yield ("tick", "3")
    yield ("count", "3", "7")
    yield ("tick", "27")
    yield ask(Type.TRACE, messages.trace(crc))
    yield ("tick", "80")
    yield ask(Type.TRACE, messages.trace(crc))
    yield ask(Type.PULSE, messages.pulse(crc, 415, 3, 6553, 30))
    yield (
        "#",
        "a configuration without a channel of the one before, which only counts; then with it",
    )
    yield ask(Type.STOP, messages.stop([0, 3], RestCode.RELAX))
    yield ask(Type.CLEAR, messages.mask_body(crc, [0, 3]))
    yield ask(Type.CONFIGURE, config("motor", {"channel": "m0"})[0])
    yield ("count", "3", "500")
    yield ("tick", "20")
    yield ask(Type.DEMAND, messages.demand(config("motor", {"channel": "m0"})[1], 500, {}))
    yield ask(Type.CONFIGURE, body)
    yield ("tick", "1")
    yield ask(Type.DEMAND, messages.demand(crc, 521, {}))


def pressure_dialogue() -> Iterator[tuple[str, ...]]:
    """Set-point, ceiling, broken wire, venting."""
    regulator = {"calibration": [[0, 0], [40, 1], [100, 3]], "readback": [[600, 0], [3000, 3]],
                 "ceiling_bar": 1.6, "wire_break_mv": 540, "trim_bar": 0.1}  # fmt: skip
    body, crc = config(
        "pressure", {"channel": "p0", **regulator}, {"channel": "p5", "on_watchdog": "close", **regulator}
    )
    yield ("board", "pressure")
    for channel in ("0", "5"):
        yield ("analog", channel, "745")
    yield ("tick", "1")
    yield ask(Type.CONFIGURE, body)
    yield ask(Type.ARM, messages.mask_body(crc, [0, 5]))
    yield ask(Type.HOME, messages.mask_body(crc, [0]))
    for i in range(20):
        for channel in ("0", "5"):
            yield ("analog", channel, str(745 + 24 * i))
        yield ("tick", "25")
        yield ask(Type.DEMAND, messages.demand(crc, 1 + 25 * i, {0: 100_000, 5: 250_000}))
    yield ("analog", "0", "0")
    yield ("tick", "25")
    yield ask(Type.DEMAND, messages.demand(crc, 501, {0: 100_000, 5: 250_000}))
    yield ask(Type.CLEAR, messages.mask_body(crc, [0]))
    yield ask(Type.ARM, messages.mask_body(crc, [0]))
    yield ("tick", "200")
    yield ask(Type.DEMAND, messages.demand(crc, 526, {}))
    yield ("tick", "600")
    yield ask(Type.DEMAND, messages.demand(crc, 726, {}))
    yield ("#", "a configuration without a channel of the one before, then with it again")
    alone, crc_alone = config("pressure", {"channel": "p0", **regulator})
    yield ask(Type.CONFIGURE, alone)
    yield ("analog", "5", "900")
    yield ("tick", "20")
    yield ask(Type.DEMAND, messages.demand(crc_alone, 1326, {}))
    yield ask(Type.CONFIGURE, body)
    yield ("tick", "1")
    yield ask(Type.DEMAND, messages.demand(crc, 1346, {}))


def held_dialogue() -> Iterator[tuple[str, ...]]:
    """A motor that holds in its safe state, with a shaft beside its set-point, until a stop lets it go."""
    body, crc = config("motor", {"channel": "m0", "on_watchdog": "hold", "start_state": "brake"})
    yield ("board", "motor")
    yield ("tick", "1")
    yield ask(Type.CONFIGURE, body)
    yield ask(Type.ARM, messages.mask_body(crc, [0]))
    yield ("tick", "101")
    yield ("count", "0", "20")
    yield ("tick", "5")
    for rest in (RestCode.HOLD, RestCode.RELAX, RestCode.HOLD):
        yield ask(Type.STOP, messages.stop([0], rest))
        yield ("tick", "1")
        yield ask(Type.DEMAND, messages.demand(crc, 1, {}))
    yield ask(Type.CLEAR, messages.mask_body(crc, [0]))
    yield ("tick", "1")
    yield ask(Type.DEMAND, messages.demand(crc, 1, {}))


def patched(body: bytes, at: int, value: int) -> bytes:
    """A configuration with one byte changed and its CRC made good again."""
    changed = bytearray(body)
    changed[at] = value
    return wiring.config_body(bytes(changed[2:]))


def ask(kind: Type, body: bytes = b"") -> tuple[str, ...]:
    """A request line."""
    return (">", messages.request(kind, 7, body).hex())


def record(lines: Iterator[tuple[str, ...]]) -> Iterator[str]:
    """Play a dialogue to the core and write it down with its answers."""
    process: subprocess.Popen[str] | None = None

    def send(line: str) -> str:
        assert process is not None and process.stdin is not None and process.stdout is not None  # noqa: PT018
        process.stdin.write(line + "\n")
        process.stdin.flush()
        return process.stdout.readline().strip()[3:]

    for line in lines:
        yield " ".join(line)
        if line[0] == "board":
            process = subprocess.Popen(
                [str(build_host()), line[1], "--lockstep"], stdin=-1, stdout=-1, text=True
            )
            send("input count 0 0")
        elif line[0] == "tick":
            send(f"step {line[1]}")
        elif line[0] in ("count", "analog"):
            send(f"input {line[0]} {line[1]} {line[2]}")
        elif line[0] == ">":
            answer = send("rx " + frames.seal(bytes.fromhex(line[1])).hex())
            payload = b"" if answer in ("-", "") else frames.unseal(bytes.fromhex(answer)[:-1])
            yield f"< {payload.hex() if payload else ''}".rstrip()
    if process is not None:
        process.communicate()


def main() -> None:
    """Write the file beside this script."""
    lines = ["# Shared vectors of the Due protocol; recorded by record.py, explained in ../PROTOCOL.md."]
    lines += [f"frame {payload.hex()} {frames.seal(payload).hex()}" for payload in PAYLOADS]
    for damaged in (
        "0000",
        "0201",
        "ff0101",
        "05aabb",
        "0301020304",
        frames.seal(b"\x01\x01\x07")[:-2].hex(),
    ):
        lines.append(f"noise {damaged}")
    lines += record(motor_dialogue())
    lines += record(pressure_dialogue())
    lines += record(held_dialogue())
    (HERE / "vectors.txt").write_text("\n".join(lines) + "\n")
    sys.stderr.write(f"{len(lines)} lines\n")


if __name__ == "__main__":
    main()
