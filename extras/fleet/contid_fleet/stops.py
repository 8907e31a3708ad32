"""Stops of a fleet: one order to every node, and who confirmed it.

Best effort: the network, a bridge or a machine may be down. It is never the only stop of a robot.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field

from contid.remote.protocol.wire import Fields
from contid_fleet.operator import ANSWER_TIMEOUT_S, FleetOperator


@dataclass(frozen=True, slots=True)
class Confirmation:
    """What a node answered to a stop that it obeyed.

    Attributes:
        tick: tick in which the control process obeyed; None before the run began.
        robots: state by robot.
        silent: axes that did not answer in that tick, by robot: the order may not have reached them.
        refused: message by robot that did not obey.
    """

    tick: int | None
    robots: Mapping[str, str]
    silent: Mapping[str, Sequence[str]] = field(default_factory=dict)
    refused: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class StopReport:
    """How a stop of the fleet went.

    Attributes:
        verb: the order, `hold`, `stop` or `estop`.
        confirmed: confirmation by node.
        refused: message by node that refused.
        missing: nodes that did not answer within `contid_fleet.operator.ANSWER_TIMEOUT_S`.
        doubled: names that several nodes have: one of them may not have confirmed.
        unlinked: endpoints without a link.
        took_s: time from the order to the last answer [s].
    """

    verb: str
    confirmed: Mapping[str, Confirmation]
    refused: Mapping[str, str]
    missing: tuple[str, ...]
    doubled: tuple[str, ...]
    unlinked: int
    took_s: float

    @property
    def complete(self) -> bool:
        """Every node that is known confirmed for every robot, and every endpoint is linked."""
        robots = self.confirmed.values()
        gaps = self.refused or self.missing or self.doubled or self.unlinked
        return bool(robots) and not gaps and not any(each.refused or each.silent for each in robots)

    def as_fields(self) -> Fields:
        """For ``--json``."""
        fields = {"ok": self.complete, **asdict(self), "took_ms": round(self.took_s * 1e3, 1)}
        del fields["took_s"]
        return fields


def stop_fleet(
    operator: FleetOperator, verb: str, nodes: Collection[str] = (), timeout_s: float = ANSWER_TIMEOUT_S
) -> StopReport:
    """Order `hold`, `stop` or `estop` at nodes, or at every node, and collect who confirmed."""
    answers = operator.ask_all(verb, {}, nodes, timeout_s)
    confirmed: dict[str, Confirmation] = {}
    refused: dict[str, str] = {}
    for name, response in sorted(answers.by_node.items()):
        if response.get("ok"):
            result = response.get("result", {})
            confirmed[name] = Confirmation(
                result.get("tick"),
                result.get("robots", {}),
                result.get("silent", {}),
                result.get("refused", {}),
            )
        else:
            refused[name] = str(response.get("error", {}).get("message", "refused"))
    return StopReport(
        verb, confirmed, refused, answers.missing, answers.doubled, answers.unlinked, answers.took_s
    )
