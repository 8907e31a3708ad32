"""Mutants of the tick: how many of a random sample of small changes the tests detect.

``python -m tests.mutation [--sample N] [--seed S] [--write]`` draws N mutants of ``contid/control/tick`` with
operators of Cosmic Ray, applies each to a copy of the repository and runs `TESTS` there. A mutant survives
when all tests pass. Exit 1 when more survive than the share in ``baseline.json`` allows; ``--write`` writes
that file. Needs ``pip install cosmic-ray``.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import Final

from cosmic_ray import plugins
from cosmic_ray.ast import ast_nodes, get_ast_from_path
from cosmic_ray.mutating import use_mutation

ROOT: Final = Path(__file__).parent.parent.parent
BASELINE: Final = Path(__file__).parent / "baseline.json"
MUTATED: Final = Path("contid/control/tick")
TESTS: Final = ("tests/golden", "tests/control/tick", "tests/control/engine")
#: Suites that also test a folder of the tick.
FURTHER: Final = {
    "contact": ("tests/sense",),
    "load_sensing": ("tests/sense",),
    "preflight": ("tests/clearance/test_preflight.py", "tests/control/daemon/test_stretch.py"),
}
TIMEOUT_S: Final = 600.0
#: Survivors allowed beyond the share of the baseline, in standard deviations of the sample.
SLACK: Final = 2.0
#: Operators whose mutants are plausible mistakes; the others mostly raise a TypeError.
OPERATORS: Final = (
    *("core/NumberReplacer", "core/AddNot", "core/ReplaceAndWithOr", "core/ReplaceOrWithAnd"),
    *("core/ReplaceTrueWithFalse", "core/ReplaceFalseWithTrue", "core/ReplaceBreakWithContinue"),
    *("core/ReplaceContinueWithBreak", "core/ReplaceUnaryOperator_USub_UAdd", "core/ZeroIterationForLoop"),
    *("core/ReplaceBinaryOperator_Add_Sub", "core/ReplaceBinaryOperator_Sub_Add"),
    *("core/ReplaceBinaryOperator_Mul_Div", "core/ReplaceBinaryOperator_Div_Mul"),
    *("core/ReplaceComparisonOperator_Lt_LtE", "core/ReplaceComparisonOperator_LtE_Lt"),
    *("core/ReplaceComparisonOperator_Gt_GtE", "core/ReplaceComparisonOperator_GtE_Gt"),
    *("core/ReplaceComparisonOperator_Lt_Gt", "core/ReplaceComparisonOperator_Gt_Lt"),
    *("core/ReplaceComparisonOperator_Eq_NotEq", "core/ReplaceComparisonOperator_NotEq_Eq"),
    *("core/ReplaceComparisonOperator_Is_IsNot", "core/ReplaceComparisonOperator_IsNot_Is"),
)
#: Editable installs find modules before PYTHONPATH does; in the copy they must not.
SITE: Final = (
    "import sys\nsys.meta_path[:] = [f for f in sys.meta_path if 'Scikit' not in type(f).__name__]\n"
)


@dataclass(frozen=True)
class Mutant:
    """One change: the n-th place of a module where an operator applies."""

    module: str
    line: int
    operator: str
    occurrence: int


def mutants(root: Path) -> Iterator[Mutant]:
    """Every mutant of the modules of the tick."""
    for path in sorted((root / MUTATED).rglob("*.py")):
        tree = get_ast_from_path(path)
        for name in OPERATORS:
            operator = plugins.get_operator(name)()
            places = (place for node in ast_nodes(tree) for place in operator.mutation_positions(node))
            for occurrence, (start, _) in enumerate(places):
                yield Mutant(str(path.relative_to(root / MUTATED)), start[0], name, occurrence)


def copy_repository(folder: Path) -> None:
    """Tracked files, and the compiled kernels beside their sources."""
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    for name in filter(None, tracked.stdout.split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    for place in import_module("contid.kernels").__path__:
        for library in Path(place).glob("*.so"):
            shutil.copy2(library, folder / "contid" / "kernels")
    (folder / "site").mkdir()
    (folder / "site" / "sitecustomize.py").write_text(SITE)


def passes(folder: Path, tests: tuple[str, ...] = TESTS) -> bool:
    """Whether all tests pass in the copy; a run that takes too long does not."""
    path = os.pathsep.join(str(folder / name) for name in ("site", ".", "drivers"))
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-x",
        "-q",
        "-p",
        "no:cacheprovider",
        "--hypothesis-seed=1",
        *tests,
    ]
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
    with subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as run:
        try:
            return run.wait(TIMEOUT_S) == 0
        except subprocess.TimeoutExpired:
            run.kill()
            return False


def survives(folder: Path, mutant: Mutant) -> bool:
    """Apply a mutant, run the tests, restore the module."""
    module = folder / MUTATED / mutant.module
    with use_mutation(module, plugins.get_operator(mutant.operator)(), mutant.occurrence):
        return passes(folder, TESTS + FURTHER.get(Path(mutant.module).parts[0], ()))


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description="Mutants of the tick.")
    parser.add_argument("--sample", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="write baseline.json")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="contid-mutants-") as name:
        folder = Path(name)
        copy_repository(folder)
        if not passes(folder):
            print("the tests fail without a mutant")
            return 2
        every = list(mutants(folder))
        sample = random.Random(asked.seed).sample(every, min(asked.sample, len(every)))
        left, begin_s = [], time.monotonic()
        for number, mutant in enumerate(sample, start=1):
            if survives(folder, mutant):
                left.append(mutant)
                print(f"survived: {mutant.module}:{mutant.line} {mutant.operator} ({mutant.occurrence})")
            seconds = time.monotonic() - begin_s
            print(f"{number}/{len(sample)}: {len(left)} survived, {seconds:.0f} s", flush=True)
    if asked.write:
        found = {"mutants": len(every), "sample": len(sample), "seed": asked.seed, "survived": len(left)}
        text = json.dumps({**found, "survivors": [asdict(mutant) for mutant in left]}, indent=1)
        BASELINE.write_text(text + "\n", encoding="utf-8")
        return 0
    before = json.loads(BASELINE.read_text(encoding="utf-8"))
    share = (before["survived"] + 1) / (before["sample"] + 2)
    allowed = len(sample) * share + SLACK * (len(sample) * share * (1.0 - share)) ** 0.5
    print(f"{len(left)} of {len(sample)} survived, {allowed:.1f} allowed")
    return int(len(left) > allowed)


if __name__ == "__main__":
    sys.exit(main())
