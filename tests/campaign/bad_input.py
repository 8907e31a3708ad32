"""The bad input campaign: whatever bytes come in, the answer is data or a `ContidError`.

``python -m tests.campaign.bad_input [--rounds N] [--seed N] [--target NAME]`` mutates a corpus at random
and prints counts; `tests.campaign.guided` is the same, guided by coverage. The address space of the process
is capped: memory without bound is a violation.
"""

from __future__ import annotations

import argparse
import io
import random
import resource
import struct
import sys
import tempfile
import traceback
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import cache
from pathlib import Path

from contid.control.engine.cycle import OnEnd
from contid.control.engine.virtual import run_virtual
from contid.control.process.pipe import RunSetup
from contid.errors import ContidError
from contid.remote.protocol.wire import RequestFields, decode, is_estop
from contid.robot_file.load import configs_folder, load_robot_file, parse_robot_file, with_mock
from contid.session.read import Session
from contid.session.recording_observer import RecordingObserver
from contid.trajectory.read import read_trajectory
from contid.trajectory.rows import RowReader
from contid_drivers.due.codes import Type
from contid_drivers.due.frames import FrameReader, seal
from contid_drivers.due.messages import read_answer
from contid_drivers.due.messages import request as payload_of
from contid_drivers.dynamixel import packets
from contid_drivers.dynamixel.exchange.block import INDIRECT, PLAIN, Block
from contid_drivers.dynamixel.exchange.fast_answer import FastAnswer
from contid_sessions.csv_files import export_joined
from contid_sessions.info import summarize
from contid_sessions.replay.replay import replay
from tests.campaign import siege
from tests.campaign.corpus import stored
from tests.campaign.shapes import SHAPES, file_of, joined, records

#: Address space of a campaign [bytes]; imports take a quarter of it.
CEILING = 4 << 30
#: What a reader of a wire may keep for later.
KEPT = 1 << 17
TOKENS = (
    *(
        b"nan",
        b"inf",
        b"-1",
        b"0",
        b"1e999",
        b"\x00",
        b"\xff",
        b"\xff\xff\xff\xff",
        b"[",
        b"{",
        b"&a [*a]",
        b"!!x",
    ),
    *(
        b'"',
        b",",
        b"\n",
        b"#",
        b": ",
        b"- ",
        b"\xfd",
        b"\xff\xff\xfd\x00",
        b"9" * 40,
        b"<<: *x",
        b"\xe2\x80\xa8",
    ),
)


@cache
def hand() -> dict[str, object]:
    return dict(load_robot_file(configs_folder() / "hand.yaml").file.robots)


def robot_file(data: bytes) -> None:
    parse_robot_file(data.decode(errors="replace"), "fuzz.yaml")


def trajectory(data: bytes) -> None:
    read_trajectory(io.StringIO(data.decode(errors="replace")), "fuzz.csv", hand())  # type: ignore[arg-type]


def stream(data: bytes) -> None:
    lines = data.decode(errors="replace").split("\n")
    parser = RowReader(lines[0], "fuzz", hand())  # type: ignore[arg-type]
    for number, line in enumerate(lines[1:], 2):
        with suppress(ContidError):
            parser.targets(line, number)


def request(data: bytes) -> None:
    """Lines of the socket, as far as no daemon is needed; `tests.campaign.siege` has one."""
    for line in data.split(b"\n"):
        is_estop(line)
        with suppress(ContidError):
            take = RequestFields(decode(line))
            take.number("timeout_s", 1.0, 0.1, 60.0)
            take.text("name", "")
            take.flag("takeover")
            take.names("robots")
            take.mapping("target")
            take.rows("rows")
            take.end()


def dynamixel(data: bytes) -> None:
    left = bytearray(data)
    while (packet := packets.take(left)) is not None:
        for layout in (INDIRECT, PLAIN):
            if (size := len(packet.parameters)) in (layout.lean, layout.full):
                Block(layout, layout.address, size).decode(packet.parameters, packet.error >= 0x80)
    assert len(left) <= KEPT
    FastAnswer((1, 2, 3), 4).feed(data)


def due(data: bytes) -> None:
    reader = FrameReader()
    for at in range(0, len(data), 7):
        for payload in reader.feed(data[at : at + 7]):
            assert len(payload) <= KEPT
            with suppress(ContidError):
                read_answer(payload)
    assert len(reader._buffer) <= KEPT


def session(data: bytes) -> None:
    with tempfile.NamedTemporaryFile(suffix=".mcap") as file:
        file.write(data)
        file.flush()
        read = Session(Path(file.name))
        summarize(read)
        export_joined(read, Path("/dev/null"))
        with suppress(ContidError):
            loaded = read.robot_file()
            read.trajectory(loaded)
            if len(data) % 8 == 0:  # as long as all the others together
                replay(read, loaded)


TARGETS: dict[str, Callable[[bytes], None]] = {
    target.__name__: target for target in (robot_file, trajectory, stream, request, dynamixel, due, session)
}


#: The target that is a process: see `tests.campaign.siege`.
SOCKET = "socket"


@cache
def corpus(name: str) -> tuple[bytes, ...]:
    """Good inputs to begin with, and the stored ones."""
    return *_good(name), *stored(name)


def _good(name: str) -> tuple[bytes, ...]:
    rows = b"t_s,left.x_mm,left.y_mm\n0,50,75\n0.5,51,75.5\n1,52,76\n"
    lines = b'{"t_s": 0, "left.x_mm": 50, "left.y_mm": 75}\n{"t_s": 1, "left.x_mm": 51, "left.y_mm": 75}\n'
    match name:
        case "robot_file":
            return tuple(path.read_bytes() for path in sorted(configs_folder().glob("*.yaml")))
        case "trajectory":
            return rows, lines
        case "stream":
            return rows.replace(b"t_s,", b""), lines.replace(b'"t_s": 0, ', b"").replace(b'"t_s": 1, ', b"")
        case "request":
            return siege.CORPUS
        case "dynamixel":
            sizes = {size for layout in (INDIRECT, PLAIN) for size in (layout.lean, layout.full)}
            blocks = b"".join(packets.build_status(1, 0, bytes(size)) for size in sorted(sizes))
            answers = b"".join(packets.build_status(i, 0, bytes(range(i, i + 14))) for i in range(3))
            return (
                answers,
                blocks,
                packets.sync_read(126, 10, (1, 2, 3), fast=True),
                packets.build(1, 2, b"\xff\xff\xfd\xfd"),
            )
        case "due":
            plain = tuple(b"".join(seal(bytes(range(n))) for n in sizes) for sizes in ((0, 3, 40), (200,)))
            return *plain, b"".join(map(seal, _answers()))
    recorded = _recorded()
    return recorded, file_of(joined(records(recorded)))


def _answers() -> list[bytes]:
    """One of every answer that a board gives."""
    telemetry = struct.pack("<IHBHBHHB", 1000, 1, 0, 0x1234, 1, 0, 0, 7) + 3 * struct.pack(
        "<BBiihh", 0x71, 0, 100, -5, 200, 0
    )
    bodies = {
        Type.TELEMETRY: telemetry,
        Type.REFUSED: bytes((1, 2, 3, 0)),
        Type.CONFIGURED: b"\x34\x12",
        Type.HELLO_ANSWER: struct.pack("<BBBBBHIBBH6B", 0, 6, 1, 0, 0, 1, 5, 0, 1, 0, *range(6)) + b"pins",
    }
    return [payload_of(kind, 1, body) for kind, body in bodies.items()]


def _recorded() -> bytes:
    loaded = with_mock(load_robot_file(configs_folder() / "finger.yaml"))
    text = "t_s,x_mm,y_mm\n0,50,75\n0.1,50.5,75\n"
    source = read_trajectory(io.StringIO(text), "t.csv", dict(loaded.file.robots))
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        path = Path(folder) / "s.mcap"
        recording = RecordingObserver(path, {"mock": "True"})
        sink = recording.follow(RunSetup(loaded, 50.0, Path(), source, OnEnd.STOP, attended=False))
        stack.callback(recording.detach)
        run_virtual(loaded, 50.0, source, sinks=[sink])
        stack.close()
        return path.read_bytes()


def mutated(data: bytes, dice: random.Random) -> bytes:
    """One to eight changes: bits, bytes, tokens, cuts, repetitions, numbers."""
    out = bytearray(data)
    for _ in range(dice.randint(1, 8)):
        at = dice.randrange(len(out) + 1)
        width = min(dice.choice((1, 2, 4, 16, 64)), len(out) - at)
        match dice.randrange(7):
            case 0 if width:
                out[at] ^= 1 << dice.randrange(8)
            case 1:
                del out[at : at + width]
            case 2:
                out[at:at] = dice.choice(TOKENS)
            case 3:
                out[at:at] = out[at : at + width] * dice.choice((1, 3, 200))
            case 4:
                out[at : at + width] = dice.randbytes(width)
            case 5:
                out[at : at + width] = dice.choice(TOKENS)
            case 6 if dice.random() < 0.2:
                del out[at:]
    return bytes(out)


def attempt(name: str, data: bytes) -> str:
    """The traceback of what should not have happened, "" when all is well."""
    try:
        TARGETS[name](data)
    except ContidError as error:
        return "" if str(error).strip() else "an error without a message"
    except Exception:
        return traceback.format_exc()
    return ""


def campaign(name: str, rounds: int, seed: int) -> list[tuple[bytes, str]]:
    """Violations: the input and the traceback."""
    dice, found = random.Random(f"{name}:{seed}"), []
    for _ in range(rounds):
        good, shape = dice.choice(corpus(name)), SHAPES.get(name)
        inside = shape is not None and dice.random() < 0.5
        data = shape(good, dice, mutated) if shape is not None and inside else mutated(good, dice)
        if message := attempt(name, data):
            found.append((data, message))
    return found


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign.bad_input", description=__doc__)
    parser.add_argument("--rounds", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--target", choices=sorted((*TARGETS, SOCKET)))
    asked = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (CEILING, CEILING))
    names = [asked.target] if asked.target else [*TARGETS, SOCKET]
    violations = 0
    print(f"{'input':<14}{'cases':>8}{'violations':>12}")
    for name in names:
        if name == SOCKET:
            found = siege.campaign(asked.rounds, asked.seed, mutated)
        else:
            found = campaign(name, asked.rounds, asked.seed)
        violations += len(found)
        print(f"{name:<14}{asked.rounds:>8}{len(found):>12}", flush=True)
        for kind in sorted({message.strip().splitlines()[-1][:200] for _, message in found})[:10]:
            example = next(message for _, message in found if message.strip().splitlines()[-1][:200] == kind)
            print("    " + "\n    ".join(example.strip().splitlines()[-5:]))
    return 1 if violations else 0


if __name__ == "__main__":
    sys.exit(main())
