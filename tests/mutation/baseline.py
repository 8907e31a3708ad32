"""What is kept: the journal of runs, and in the repository the baseline with the known equivalent mutants."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from tests.mutation.mutants import ROOT, Mutant, change, fingerprint

BASELINE: Final = Path(__file__).parent / "baseline.json"
FOLDER: Final = ROOT / "build" / "mutation"
#: Survivors allowed beyond the share of the baseline, in standard deviations of the sample.
SLACK: Final = 2.0
#: A mutant that no test executes.
UNTESTED: Final = "no test executes it"


class Journal:
    """The results of one state of all files but those of tests; a result holds while its tests stay the same.

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
        self._stamps: dict[str, str] = {name: stamp for name, _, stamp in entries}

    def has(self, mutant: Mutant, tests: Sequence[str]) -> bool:
        """True when the tests of a mutant need not run again."""
        detected = self.found.get(mutant.name)
        return detected is not None and self._stamps[mutant.name] == _stamp(detected, tests)

    def again(self) -> Journal:
        """With what other processes have added."""
        return Journal(self._path)

    def keep(self, mutant: Mutant, detected: str, tests: Sequence[str]) -> None:
        """Add a result."""
        self.found[mutant.name] = detected
        self._stamps[mutant.name] = stamp = _stamp(detected, tests)
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps([mutant.name, detected, stamp]) + "\n")


def _stamp(detected: str, tests: Sequence[str]) -> str:
    """What a result depends on: the file of the test that detected the mutant, or all tests that ran."""
    ran = [detected] if "::" in detected else sorted(tests)
    files = fingerprint(sorted({name.split("::")[0] for name in ran}))
    return f"{files}-{hashlib.sha256(' '.join(ran).encode()).hexdigest()[:12]}"


class Baseline:
    """The file in the repository.

    Attributes:
        equivalent: by module, line before and after: why the change has no effect.
    """

    def __init__(self) -> None:
        self._kept = json.loads(BASELINE.read_text(encoding="utf-8"))
        self.equivalent = {
            (module, was, now): why for module, was, now, why in self._kept.get("equivalent", [])
        }

    def is_equivalent(self, text: str, mutant: Mutant) -> bool:
        """True for a mutant that changes nothing that a test could see."""
        return (mutant.module, *change(text, mutant)) in self.equivalent

    def allowed(self, sample: int) -> float:
        """Survivors that a sample of this size may have, by one for which no test had been written yet."""
        fresh = self._kept["fresh"]
        share = (fresh["survived"] + 1) / (fresh["sample"] + 2)
        return float(sample * share + SLACK * (sample * share * (1.0 - share)) ** 0.5)

    def write(
        self,
        every: int,
        seed: int,
        drawn: int,
        sample: Sequence[Mutant],
        survivors: Sequence[Mutant],
        sources: Mapping[str, str],
    ) -> None:
        """Replace the figures of a sample without its equivalent mutants; the rest of the file stays."""
        count, survived = (Counter(each.folder for each in some) for some in (sample, survivors))
        found: dict[str, Any] = {
            "mutants": every,
            "seed": seed,
            "equivalents": drawn - len(sample),
            "sample": len(sample),
            "survived": len(survivors),
            "fresh": self._kept["fresh"],
            "folders": {name: [survived[name], count[name]] for name in sorted(count)},
            "survivors": [
                [mutant.module, mutant.line, *change(sources[mutant.module], mutant)] for mutant in survivors
            ],
            "equivalent": self._kept.get("equivalent", []),
        }
        BASELINE.write_text(_json(found), encoding="utf-8")


def _json(found: Mapping[str, Any]) -> str:
    """With one line per mutant."""
    parts = []
    for key, value in found.items():
        text = json.dumps(value)
        if isinstance(value, list) and value:
            rows = ",\n  ".join(json.dumps(row, ensure_ascii=False) for row in value)
            text = f"[\n  {rows}\n ]"
        parts.append(f" {json.dumps(key)}: {text}")
    return "{\n" + ",\n".join(parts) + "\n}\n"
