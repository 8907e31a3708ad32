"""What is kept: the journal of runs, and in the repository the baseline with the known equivalent mutants."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from tests.mutation.mutants import ROOT, Mutant, change

BASELINE: Final = Path(__file__).parent / "baseline.json"
FOLDER: Final = ROOT / "build" / "mutation"
#: Survivors allowed beyond the share of the baseline, in standard deviations of the sample.
SLACK: Final = 2.0
#: A mutant that no test executes.
UNTESTED: Final = "no test executes it"


class Journal:
    """The results of one state of the sources.

    Args:
        path: of its file; an interrupted run goes on from it.

    Attributes:
        found: by name of a mutant the test that detected it, "" for none.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        entries = [json.loads(line) for line in lines]
        self.found: dict[str, str] = {name: detected for name, detected, _ in entries}
        self._budget_s: dict[str, float] = {name: budget_s for name, _, budget_s in entries}

    def has(self, mutant: Mutant, budget_s: float) -> bool:
        """True when the tests of a mutant need not run again."""
        return bool(self.found.get(mutant.name)) or self._budget_s.get(mutant.name, -1.0) >= budget_s

    def again(self) -> Journal:
        """With what other processes have added."""
        return Journal(self._path)

    def keep(self, mutant: Mutant, detected: str, budget_s: float) -> None:
        """Add a result, and the processor time that the tests had."""
        self.found[mutant.name] = detected
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps([mutant.name, detected, budget_s]) + "\n")


class Baseline:
    """The file in the repository.

    Attributes:
        equivalent: by module, line before and after: why the change changes nothing.
    """

    def __init__(self) -> None:
        self._kept = json.loads(BASELINE.read_text(encoding="utf-8"))
        self.equivalent = {
            (module, was, now): each["reason"]
            for each in self._kept.get("equivalent", [])
            for module, was, now in each["changes"]
        }

    def is_equivalent(self, text: str, mutant: Mutant) -> bool:
        """True for a mutant that changes nothing that a test could see."""
        return (mutant.module, *change(text, mutant)) in self.equivalent

    def allowed(self, sample: int) -> float:
        """Survivors that a sample of this size may have."""
        share = (self._kept["survived"] + 1) / (self._kept["sample"] + 2)
        return float(sample * share + SLACK * (sample * share * (1.0 - share)) ** 0.5)

    def write(
        self,
        every: int,
        seed: int,
        sample: Sequence[Mutant],
        left: Sequence[Mutant],
        sources: Mapping[str, str],
    ) -> None:
        """Replace the figures; the equivalent mutants stay."""
        equivalent = [mutant for mutant in left if self.is_equivalent(sources[mutant.module], mutant)]
        survivors = [mutant for mutant in left if mutant not in equivalent]
        drawn, survived = (Counter(each.folder for each in some) for some in (sample, survivors))
        found: dict[str, Any] = {
            "mutants": every,
            "sample": len(sample),
            "seed": seed,
            "equivalents": len(equivalent),
            "survived": len(survivors),
            "folders": {name: [survived[name], drawn[name]] for name in sorted(drawn)},
            "survivors": [
                [mutant.module, mutant.line, *change(sources[mutant.module], mutant)] for mutant in survivors
            ],
            "equivalent": self._kept.get("equivalent", []),
        }
        BASELINE.write_text("".join(_lines(found)), encoding="utf-8")


def _lines(found: Mapping[str, Any]) -> Iterator[str]:
    """JSON with one line per mutant."""
    indented = json.dumps(found, indent=1, ensure_ascii=False)
    depth, text = 0, ""
    for line in indented.splitlines():
        stripped = line.strip()
        opens = stripped.endswith("[") and stripped == "["
        if opens and not depth:
            depth, text = 1, line
        elif depth and stripped in ("]", "],"):
            yield text + stripped + "\n"
            depth = 0
        elif depth:
            text += stripped + (" " if stripped.endswith(",") else "")
        else:
            yield line + "\n"
