"""The short form of the fault campaign, and the deliberate bugs that it has to find.

``CONTID_CAMPAIGN_CASES=5000 pytest tests/campaign`` or ``python -m tests.campaign`` run the long form.
"""

from __future__ import annotations

import os
from dataclasses import replace

import pytest

from tests.campaign.campaign import campaign
from tests.campaign.mutations import MUTATIONS
from tests.campaign.script import machines

CASES = int(os.environ.get("CONTID_CAMPAIGN_CASES", "24"))


@pytest.fixture(scope="module")
def names() -> set[str]:
    """Of the machines, which take half a second to make."""
    return {machine.name for machine in machines()}


@pytest.mark.campaign
def test_no_fault_in_any_state_makes_anything_unsafe() -> None:
    tally = campaign(CASES, seed=int(os.environ.get("CONTID_CAMPAIGN_SEED", "1")))
    print(tally.table())
    assert tally.cases == CASES
    assert not sum(tally.violations.values()), "\n".join(tally.message)


@pytest.mark.parametrize("bug", MUTATIONS)
def test_a_deliberate_bug_can_be_put_in_place(
    bug: str, names: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    MUTATIONS[bug].apply(monkeypatch)
    assert MUTATIONS[bug].machine in names


@pytest.mark.campaign
@pytest.mark.parametrize("bug", MUTATIONS)
def test_a_deliberate_bug_is_found(bug: str, monkeypatch: pytest.MonkeyPatch) -> None:
    MUTATIONS[bug].apply(monkeypatch)
    (machine,) = [machine for machine in machines() if machine.name == MUTATIONS[bug].machine]
    # Without clearance its robots do not act on each other.
    file = machine.loaded.file.model_copy(update={"clearance": None})
    free = replace(machine, loaded=replace(machine.loaded, file=file))
    tally = campaign(60, seed=MUTATIONS[bug].seed, on=[free], until=MUTATIONS[bug].breaks)
    assert tally.violations[MUTATIONS[bug].breaks], tally.table()
