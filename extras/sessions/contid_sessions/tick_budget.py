"""What `contid check --budget` measures: a tick by robot and bus, and how large recordings become."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from contid.control.daemon.budget import Budget
from contid.control.daemon.tick_times import measure_budget
from contid.robot_file.load import LoadedFile
from contid_sessions.recording_size import PredictedSize, predicted_size


@dataclass(frozen=True, slots=True)
class BudgetReport:
    """Measured ticks of a robot file in every kind of motion, and the size of its recordings."""

    budget: Budget
    size: PredictedSize

    def refusal(self) -> str:
        """Why a run would be refused; empty when it fits."""
        return self.budget.refusal()

    def lines(self) -> Iterator[str]:
        """For a person: what every robot and bus takes of a period."""
        budget = self.budget
        period_s = 1.0 / budget.rate_hz

        def share(took_s: float) -> str:
            return f"{100.0 * took_s * budget.rate_hz:.1f} % of {1e3 * period_s:.3g} ms"

        motions = " / ".join(cost.motion for cost in budget.costs)
        yield f"budget of a tick, processor time in {motions}:"
        for name in budget.costs[0].robots_s:
            yield f"  robot {name}: {' / '.join(share(cost.robots_s[name]) for cost in budget.costs)}"
        for name in budget.costs[0].buses_s:
            if name in budget.own:
                shares = " / ".join(share(cost.buses_s[name]) for cost in budget.costs)
                yield f"  bus {name}: {shares}, simulated devices"
            elif name in budget.wires_s:
                yield f"  bus {name}: {share(budget.wires_s[name])} at least on its wire"
            else:
                yield f"  bus {name}: not known before it runs"
        yield f"  all: {' / '.join(share(cost.work_s(budget.own)) for cost in budget.costs)}"
        yield f"  highest rate that fits: {budget.highest_rate_hz:g} Hz"
        yield str(self.size)

    def as_dict(self) -> Mapping[str, Any]:
        """For JSON; times in seconds; ``refusal`` is why a run would be refused, None when it fits."""
        budget = self.budget
        return {
            "refusal": self.refusal() or None,
            "rate_hz": budget.rate_hz,
            "highest_rate_hz": budget.highest_rate_hz,
            "wires_s": dict(budget.wires_s),
            "motions": {
                cost.motion: {
                    "tick_s": cost.work_s(budget.own),
                    "robots_s": dict(cost.robots_s),
                    "buses_s": {name: cost.buses_s[name] for name in cost.buses_s if name in budget.own},
                    "rest_s": cost.rest_s,
                }
                for cost in budget.costs
            },
            "recording_bytes_per_hour": asdict(self.size),
        }


def budget_report(loaded: LoadedFile) -> BudgetReport:
    """Measure a file at its own rate, and record a part of the stream for the size.

    Raises:
        ContidError: the simulated robots cannot be built, or no temporary file can be written.
    """
    found: list[Budget] = []
    rate_hz = loaded.file.rate_hz
    size = predicted_size(
        loaded,
        rate_hz,
        lambda sink: found.append(
            measure_budget(loaded, rate_hz, virtual_s=2.0, longest_s=1.0, records=sink)
        ),
    )
    return BudgetReport(found[0], size)
