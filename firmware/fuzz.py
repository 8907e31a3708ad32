"""Fuzz the firmware's parser and states, guided by coverage: ``python firmware/fuzz.py [INPUTS] [SEED]``.

Uses libFuzzer when clang is installed (``apt install clang``), else g++ with its own coverage callback and
the loop in ``host/fuzz.cpp``; ASan and UBSan watch in both. Seeds are the shared vectors. The default of 1e7
inputs takes about 20 minutes of one core with g++; the tests run a short one.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
#: Operations of an input, as host/fuzz.cpp decodes them: the first byte modulo 5.
TICKS, PAYLOAD, PAYLOAD_WITH_CRC, CONFIGURATION = 14, 1, 2, 3
SANITIZE = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g", "-O1", "-std=gnu++17"]


def seeds() -> list[bytes]:
    """The dialogues of the vectors as inputs of the fuzzer, whole and request by request."""
    found: list[bytes] = []
    dialogue = bytearray()
    for line in (HERE / "vectors" / "vectors.txt").read_text().splitlines():
        item, *rest = line.split() or [""]
        if item == "board":
            found.append(bytes(dialogue))
            dialogue = bytearray([0 if rest[0] == "motor" else 1])
        elif item == "tick":
            dialogue += bytes([TICKS, 6]) + (100).to_bytes(4, "little") + (745).to_bytes(2, "little")
        elif item == ">":
            payload = bytes.fromhex(rest[0])
            configure = len(payload) > 9 and payload[1] == 2
            with_crc = PAYLOAD_WITH_CRC if len(payload) >= 5 else PAYLOAD
            operation = CONFIGURATION if configure else with_crc
            length = (len(payload) + 2) // 3 if configure else len(payload)
            payload += bytes(length * 3 - len(payload)) if configure else b""
            dialogue += bytes([operation, length & 0xFF]) + payload
            found.append(bytes(dialogue[-(len(payload) + 2) :]))
    found.append(bytes(dialogue))
    return [dialogue for dialogue in found if dialogue]


FUZZER = str(HERE / "host" / "fuzz.cpp")
CORE = [str(path) for path in sorted((HERE / "contid_due/src/core").rglob("*.cpp"))]


def with_clang(inputs: int, seed: int, folder: Path) -> int:
    """With libFuzzer."""
    program = folder / "fuzz"
    flags = [*SANITIZE, "-DCONTID_LIBFUZZER", "-fsanitize=fuzzer"]
    subprocess.run(["clang++", *flags, "-o", str(program), FUZZER, *CORE], check=True)
    corpus = folder / "corpus"
    corpus.mkdir()
    for i, one in enumerate(seeds()):
        (corpus / str(i)).write_bytes(one)
    return subprocess.run(
        [program, f"-runs={inputs}", f"-seed={seed}", "-max_len=2048", corpus], check=False
    ).returncode


def with_gcc(inputs: int, seed: int, folder: Path) -> int:
    """With gcc's coverage callback and our own loop."""
    program = folder / "fuzz"
    # Coverage of the core only: that of the fuzzer's own code would not guide it.
    compiled = ["g++", *SANITIZE, "-fsanitize-coverage=trace-pc", "-c", *CORE]
    subprocess.run(compiled, cwd=folder, check=True)
    objects = map(str, folder.glob("*.o"))
    subprocess.run(["g++", *SANITIZE, "-o", str(program), FUZZER, *objects], check=True)
    text = "\n".join(one.hex() for one in seeds())
    return subprocess.run([program, str(inputs), str(seed)], input=text, text=True, check=False).returncode


def main() -> int:
    """Build in a temporary folder and run."""
    inputs = int(float(sys.argv[1])) if len(sys.argv) > 1 else 10_000_000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    with tempfile.TemporaryDirectory() as folder:
        run = with_clang if shutil.which("clang++") else with_gcc
        return run(inputs, seed, Path(folder))


if __name__ == "__main__":
    sys.exit(main())
