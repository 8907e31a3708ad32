"""One build of the kernels with all drawn mutants in it, in a folder of its own."""

from __future__ import annotations

import random
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

from contid.kernels import KERNELS
from tests.mutation.kernels.sources import Mutant, mutants, mutated

ROOT: Final = Path(__file__).parents[3]
FOLDER: Final = ROOT / "build/mutation"
#: More are drawn than are asked for: some of them do not compile.
SPARE: Final = 1.5
LIBRARY: Final = "libmutant.so"
#: A file and a line of the compiler's first words about an error, or about where it was instantiated from.
ERROR: Final = re.compile(
    r"^(?P<file>[^\s:]+\.[ch]pp):(?P<line>\d+):\d+: (?P<what>error|  required from)", re.MULTILINE
)


def built(count: int, seed: int, part: str = "") -> tuple[Path, dict[int, Mutant]]:
    """Compile ``count`` drawn mutants: the folder of the extension modules, and the mutants by number.

    Args:
        count: how many; fewer if there are not as many.
        seed: of the draw.
        part: only files of the kernels whose path begins with this.
    """
    sources, scratch = ROOT / "contid/kernels", FOLDER / "kernels"
    shutil.rmtree(scratch, ignore_errors=True)
    every = [mutant for mutant in mutants(sources) if mutant.file.startswith(part)]
    drawn = random.Random(seed).sample(every, min(len(every), int(SPARE * count)))
    numbered = dict(enumerate(drawn, 1))
    library = _choice(scratch, len(numbered))
    while True:
        _write(sources, scratch / "tree/contid/kernels", numbered)
        refused = _compiled(scratch, library, numbered)
        if not refused:
            break
        for number in refused:
            del numbered[number]
    while len(numbered) > count:
        numbered.popitem()
    return scratch, numbered


def _choice(scratch: Path, count: int) -> Path:
    """The library that holds which mutant is chosen, and which were reached."""
    scratch.mkdir(parents=True)
    text = f"int contid_mutant = 0; unsigned char contid_mutant_reached[{count + 1}];"
    (scratch / "mutant.c").write_text(text, encoding="utf-8")
    subprocess.run(["cc", "-shared", "-fPIC", "-o", LIBRARY, "mutant.c"], cwd=scratch, check=True)
    return scratch / LIBRARY


def _write(sources: Path, to: Path, numbered: dict[int, Mutant]) -> None:
    """Write the tree; files that are the same keep their time, so that they are not compiled again."""
    to.mkdir(parents=True, exist_ok=True)
    shutil.copy(ROOT / "CMakeLists.txt", to.parents[1])
    for folder in ("configs", "firmware", "host", "udev", "service"):
        (to.parents[1] / folder).mkdir(exist_ok=True)
    for path in sorted(sources.rglob("*")):
        target = to / path.relative_to(sources)
        if path.suffix in (".cpp", ".hpp"):
            text = path.read_text(encoding="utf-8")
            file = str(path.relative_to(sources))
            text = mutated(text, [(number, each) for number, each in numbered.items() if each.file == file])
        elif path.name == "CMakeLists.txt":
            text = re.sub(r"-O[23]\b", "-O1", path.read_text(encoding="utf-8"))
        else:
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        if not target.exists() or target.read_text(encoding="utf-8") != text:
            target.write_text(text, encoding="utf-8")


def _compiled(scratch: Path, library: Path, numbered: dict[int, Mutant]) -> set[int]:
    """Compile; the numbers of the mutants that the compiler refuses."""
    tree, build = scratch / "tree", scratch / "build"
    header = Path(__file__).parent / "mutant.hpp"
    if not (build / "build.ninja").exists():
        configure = [
            "cmake", "-G", "Ninja", "-S", str(tree), "-B", str(build),
            f"-DPython_EXECUTABLE={sys.executable}",
            "-DCMAKE_BUILD_TYPE=None", f"-DCMAKE_CXX_FLAGS=-include {header} -w",
            f"-DCMAKE_SHARED_LINKER_FLAGS={library}", f"-DCMAKE_MODULE_LINKER_FLAGS={library}",
        ]  # fmt: skip
        subprocess.run(configure, check=True, stdout=subprocess.DEVNULL)
    make = ["cmake", "--build", str(build), "--", "-k", "0", *(f"_{name}" for name in KERNELS)]
    made = subprocess.run(make, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if not made.returncode:
        return set()
    refused = set[int]()
    kernels = tree / "contid/kernels"
    for found in ERROR.finditer(made.stdout):
        path = Path(build, found["file"]).resolve()
        if path.is_relative_to(kernels):
            file, line = str(path.relative_to(kernels)), int(found["line"])
            refused |= {number for number, each in numbered.items() if (each.file, each.line) == (file, line)}
    if not refused:
        raise SystemExit(
            f"the mutants do not compile, and no line of theirs is named:\n{made.stdout[-4000:]}"
        )
    return refused
