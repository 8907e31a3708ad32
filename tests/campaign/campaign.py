"""The campaign: thousands of cases from one seed, counted per invariant."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

from contid.control.tick.supervisor import Mode
from tests.campaign.invariants import ALONE, UNAFFECTED, unaffected
from tests.campaign.script import Case, Machine, Script, machines
from tests.campaign.watch import Seen, watch

#: Violations kept with their message.
KEPT = 20


@dataclass
class Tally:
    """What a campaign counted."""

    seed: int
    cases: int = 0
    ticks: int = 0
    seconds: float = 0.0
    checks: Counter[str] = field(default_factory=Counter)
    violations: Counter[str] = field(default_factory=Counter)
    faults: Counter[tuple[str, str]] = field(default_factory=Counter)
    machines: Counter[str] = field(default_factory=Counter)
    message: list[str] = field(default_factory=list)

    def judge(self, seen: Seen, reference: Seen) -> None:
        """Check one run against every invariant."""
        case = seen.case
        self.cases += 1
        self.ticks += len(seen.records)
        self.machines[case.machine.name] += 1
        if case.hits:
            self.faults[case.hits[-1]] += 1
        for name, check in ALONE.items():
            self._count(name, case, list(check(seen)))
        self._count(UNAFFECTED, case, list(unaffected(seen, reference)))

    def _count(self, name: str, case: Case, found: list[str]) -> None:
        self.checks[name] += 1
        self.violations[name] += bool(found)
        if found and len(self.message) < KEPT:
            what = ", ".join(f"{f.kind} {f.axis or f.bus} {f.tick}+{f.ticks}" for f in case.faults)
            where = f"{case.machine.name}, seed {self.seed}:{case.number}; {what or 'no fault'}"
            self.message.append(f"{name}: {found[0]} [{where}]")

    def table(self) -> str:
        """Counts per invariant, then faults by the state they met."""
        lines = [
            f"{self.cases} cases, {self.ticks} ticks in virtual time, seed {self.seed}, {self.seconds:.0f} s",
            ", ".join(f"{name} {count}" for name, count in sorted(self.machines.items())),
            "",
            f"{'invariant':<36}{'cases':>8}{'violations':>12}",
            *(
                f"{name:<36}{self.checks[name]:>8}{self.violations[name]:>12}"
                for name in (*ALONE, UNAFFECTED)
            ),
            "",
            "faults injected, by the state of the robot:",
        ]
        modes = [mode.name for mode in Mode]
        kinds = sorted({kind for kind, _ in self.faults})
        lines.append(" " * 10 + "".join(f"{mode:>11}" for mode in modes))
        lines += [
            f"{kind:<10}" + "".join(f"{self.faults[kind, mode]:>11}" for mode in modes) for kind in kinds
        ]
        return "\n".join([*lines, *(["", *self.message] if self.message else [])])


def campaign(
    cases: int,
    seed: int,
    progress: Callable[[Tally], None] | None = None,
    on: list[Machine] | None = None,
    until: str | None = None,
) -> Tally:
    """Run ``cases`` cases: scripts without a fault, each followed by itself with one to four faults.

    Args:
        cases: how many.
        seed: decides all of them.
        progress: called now and then.
        on: instead of every machine.
        until: end early once this invariant was violated.
    """
    tally = Tally(seed)
    begin_s = time.monotonic()
    every = machines() if on is None else on
    number = 0
    while tally.cases < cases and not (until and tally.violations[until]):
        script = Script(every[number % len(every)], number, seed)
        reference = seen = watch(script.case())
        tally.judge(seen, reference)
        for _ in range(script.random.randint(2, 4)):
            if tally.cases >= cases or seen.case.dies_at is not None:
                break
            names = {robot: [Mode(mode).name for mode in modes] for robot, modes in seen.modes().items()}
            seen = watch(script.with_fault(seen.case, names))
            tally.judge(seen, reference)
        number += 1
        tally.seconds = time.monotonic() - begin_s
        if progress is not None:
            progress(tally)
    return tally
