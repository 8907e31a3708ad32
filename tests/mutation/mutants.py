"""Mutants: every small change of the tick that an operator of Cosmic Ray makes, and its source text."""

from __future__ import annotations

import hashlib
import re
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from cosmic_ray import plugins
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code

ROOT: Final = Path(__file__).parent.parent.parent
MUTATED: Final = Path("contid/control/tick")
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
#: What has no mutants, as text before the place: it refuses mistakes of callers that there are none of.
_GUARDS: Final = re.compile(r"^\s*@dataclass\(|\bstrict=$")
_DECIDING: Final = frozenset({".py", ".cpp", ".hpp", ".yaml", ".mcap"})


@dataclass(frozen=True)
class Mutant:
    """One change: the n-th place of a module where an operator applies.

    Attributes:
        module: path below the tick.
        line: number of the line.
        operator: of Cosmic Ray.
        occurrence: n.
    """

    module: str
    line: int
    operator: str
    occurrence: int

    @property
    def name(self) -> str:
        """Unique, for the journal."""
        return f"{self.module}:{self.line}:{self.operator.removeprefix('core/')}:{self.occurrence}"

    @property
    def folder(self) -> str:
        """Of the tick; "." for its own modules."""
        return Path(self.module).parts[0] if "/" in self.module else "."


def modules() -> dict[str, str]:
    """Source texts of the tick by path below it."""
    folder = ROOT / MUTATED
    return {
        path.relative_to(folder).as_posix(): path.read_text(encoding="utf-8")
        for path in sorted(folder.rglob("*.py"))
    }


def tracked() -> list[str]:
    """Files of the repository that decide what the tests find."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "-co", "--exclude-standard", "contid", "drivers", "tests", "configs"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    names = sorted(name for name in listed.stdout.split("\0") if Path(name).suffix in _DECIDING)
    return [name for name in names if not name.startswith("tests/mutation/") and (ROOT / name).is_file()]


def is_test(name: str) -> bool:
    """True for a file of tests; what all of them share is none."""
    return Path(name).name.startswith("test_")


def fingerprint_of_the_rest() -> str:
    """Changes when a file does that is no file of tests."""
    return fingerprint(name for name in tracked() if not is_test(name))


def fingerprint(names: Iterable[str]) -> str:
    """Changes when a file does."""
    found = hashlib.sha256()
    for name in names:
        found.update(name.encode() + (ROOT / name).read_bytes())
    return found.hexdigest()[:12]


def mutants(sources: dict[str, str]) -> Iterator[Mutant]:
    """Every mutant, in a fixed order."""
    for module, text in sources.items():
        tree, lines = get_ast(text), text.splitlines()
        for name in OPERATORS:
            operator = plugins.get_operator(name)()
            places = (place for node in ast_nodes(tree) for place in operator.mutation_positions(node))
            for occurrence, (start, _) in enumerate(places):
                if not _GUARDS.search(lines[start[0] - 1][: start[1]]):
                    yield Mutant(module, start[0], name, occurrence)


def sampled(every: Sequence[Mutant], size: int, seed: int) -> list[Mutant]:
    """A random sample over all folders; where other mutants come or go, the rest of it stays the same."""

    def drawn(mutant: Mutant) -> bytes:
        return hashlib.sha256(f"{seed} {mutant.name}".encode()).digest()

    return sorted(every, key=drawn)[:size]


def mutated(text: str, mutant: Mutant) -> str:
    """The source text of the module with the change."""
    changed: str = mutate_code(text, plugins.get_operator(mutant.operator)(), mutant.occurrence)
    assert changed is not None
    return changed


def change(text: str, mutant: Mutant) -> tuple[str, str]:
    """The changed line before and after, without indentation."""
    pairs = zip(text.splitlines(), mutated(text, mutant).splitlines(), strict=False)
    return next((was.strip(), now.strip()) for was, now in pairs if was != now)
