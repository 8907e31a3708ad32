"""The deliberate bugs of the campaign fit what they are put into; it finds them in `test_campaign`."""

from __future__ import annotations

import pytest

from tests.campaign.mutations import MUTATIONS
from tests.campaign.script import machines


@pytest.mark.parametrize("bug", MUTATIONS)
def test_a_deliberate_bug_can_be_put_in_place(bug: str, monkeypatch: pytest.MonkeyPatch) -> None:
    MUTATIONS[bug].apply(monkeypatch)
    assert MUTATIONS[bug].machine in {machine.name for machine in machines()}
