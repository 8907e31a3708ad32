"""The table of all campaigns, with short parts."""

from __future__ import annotations

import pytest

from tests.campaign.everything import Part, everything, parts

pytestmark = pytest.mark.campaign


def test_every_part_gets_its_slices_and_a_violation_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    good = Part("good", "-m tests.campaign --cases 2 --seed {seed}", 2)
    bad = Part("bad", "-m tests.campaign.bad_input --target nothing --seed {seed}", 1)
    assert everything(0.0, 5, [good, bad]) == 1
    assert (good.slices, good.failed, bad.slices, bad.failed) == (1, 0, 1, 1)
    printed = capsys.readouterr().out
    assert "$ python -m tests.campaign.bad_input --target nothing --seed 5" in printed
    assert "invalid choice: 'nothing'" in printed


def test_all_inputs_are_a_part() -> None:
    names = [part.name for part in parts()]
    assert len(names) == len(set(names)) >= 10
