"""The model under loads: answers meet their targets with weight and force, and every tendon stays taut."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contid.errors import BadInputError
from contid.kinematics.model import build_model
from contid.robot_file.load import parse_robot_file
from contid.targets import Actuation, Target
from contid_tendons.loaded import LoadedTendonModel
from contid_tendons.rod import TendonEquilibrium, TendonRod
from tests.oracles.tendon_energy import Energy


def loaded(configs: Path, rod: str, remove: str = "") -> LoadedTendonModel:
    text = (configs / "tendon3.yaml").read_text().replace("    rates:\n", f"    rod: {rod}\n    rates:\n", 1)
    (robot,) = parse_robot_file(text.replace(remove, "") if remove else text, "t.yaml").file.robots.values()
    assert "load" in robot.accepts
    model = build_model(robot)
    assert isinstance(model, LoadedTendonModel)
    return model


@pytest.mark.parametrize("rod", ["{weight_n_per_m: [0.5]}", "{weight_n_per_m: [0.5], stretch_n: [4000]}"])
def test_answers_meet_their_targets_and_keep_every_tendon_taut(configs: Path, rod: str) -> None:
    model, rng = loaded(configs, rod), np.random.default_rng(2)
    assert model.statics is not None
    feasible = model.feasible
    for case in range(6):
        bends = 0.6 * feasible.pulled(rng.uniform(feasible.low, feasible.high))
        pulls = model.statics.pulls(bends / np.repeat(feasible.sections.backbone_m, 2))
        x, y, z = rng.uniform(-0.05, 0.05, 3).tolist()
        pose = model.forward(tuple(pulls.tolist()), (x, y, z))
        direction = pose.direction if case % 2 else None
        answer = model.inverse(Target(tip_m=pose.tip_m, direction=direction, load_n=(x, y, z)), (0.0,) * 9)
        assert answer.converged
        there = model.equilibrium(answer.actuation, (x, y, z))
        assert there.tip_m == pytest.approx(pose.tip_m, abs=1e-7)
        assert np.min(there.tensions_n) >= model.statics.floor_n - 1e-5
        assert np.max(there.tensions_n) <= model.statics.limit_n + 1e-5
        if direction is not None:
            assert there.rotation[:, 2] == pytest.approx(direction, abs=1e-6)


def test_a_path_under_weight_is_followed_from_answer_to_answer(configs: Path) -> None:
    """As the tick asks: each target from the answer before; the energy of the rod judges."""
    load_n = (0.02, 0.0, -0.05)
    model = loaded(configs, "{weight_n_per_m: [0.8], elements: 4}").for_ticks()
    assert model.statics is not None
    seed: Actuation = (0.0,) * 9
    for k in range(0, 120, 2):  # some of these need a second start
        angle = 0.01 * k
        target = Target(tip_m=(0.05 * math.cos(angle), 0.05 * math.sin(angle), 0.27), load_n=load_n)
        answer = model.inverse(target, seed)
        assert answer.converged, (k, answer.note)
        seed = answer.actuation
        # Where a second start was needed rounding decides how near it stopped: 0.5 um were seen.
        assert model.inverse(target, seed).actuation == pytest.approx(seed, abs=1e-6)
        if k % 20 == 0:
            there = model.equilibrium(seed, load_n)
            energy, strain = Energy(model.rod, seed, load_n), there.strain.ravel()
            stiffest = float(model.rod.discrete.stiffness[:, 0].max())
            assert np.linalg.norm(energy.gradient(strain)) <= 2e-7 * stiffest
            assert energy.placed(strain)[2] == pytest.approx(target.tip_m, abs=1e-6)
            assert np.min(energy.tensions(strain)) >= model.statics.floor_n - 1e-5


def test_ticks_search_less_for_a_target_out_of_reach(configs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model, solve = loaded(configs, "{weight_n_per_m: [0.5]}"), TendonRod.solve
    counts: list[int] = []

    def counted(*arguments: Any, **options: Any) -> TendonEquilibrium:
        counts[-1] += 1
        return solve(*arguments, **options)

    monkeypatch.setattr(TendonRod, "solve", counted)
    target, answers = Target(tip_m=(0.25, 0.0, 0.35)), []
    for each in (model, model.for_ticks()):
        counts.append(0)
        answers.append(each.inverse(target, (0.0,) * 9))
    assert [answer.converged for answer in answers] == [False, False]
    assert answers[1].residual_m == pytest.approx(answers[0].residual_m, rel=0.01)
    assert counts[-1] < 0.5 * counts[-2]


def test_weight_pulls_a_bent_robot_down_and_its_shape_ends_at_its_tip(configs: Path) -> None:
    model, light = loaded(configs, "{weight_n_per_m: [1]}"), loaded(configs, "{}")
    assert light.statics is not None
    pulls = tuple(light.statics.pulls(np.array([0.3, 0.0, 0.3, 0.0, 0.3, 0.0])).tolist())
    assert model.forward(pulls).tip_m[2] < light.forward(pulls).tip_m[2] - 0.001
    shape = model.shape(pulls, 40)
    assert shape[0] == pytest.approx((0.0, 0.0, 0.0))
    assert shape[-1] == pytest.approx(model.forward(pulls).tip_m)
    steps = np.linalg.norm(np.diff(shape, axis=0), axis=1)
    assert steps.sum() == pytest.approx(0.315, abs=2e-4)


def test_a_force_beyond_the_robot_is_answered_with_what_is_left(configs: Path) -> None:
    model = loaded(configs, "{}")
    answer = model.inverse(Target(tip_m=(0.15, 0.0, 0.2), load_n=(0.0, 0.0, -2.0)), (0.0,) * 9)
    assert not answer.converged
    assert answer.residual_m > 1e-4
    assert math.isfinite(answer.residual_m)


def test_a_rod_needs_tension(configs: Path) -> None:
    text = (configs / "tendon3.yaml").read_text()
    begin, end = text.index("    tension:"), text.index("    rates:")
    text = f"{text[:begin]}    rod: {{}}\n{text[end:]}"
    with pytest.raises(BadInputError, match="rod needs tension"):
        parse_robot_file(text, "t.yaml")
    text = (configs / "tendon3.yaml").read_text()
    with pytest.raises(BadInputError, match=r"rod\.stretch_n has 2 entries; allowed: 1 or 3"):
        parse_robot_file(
            text.replace("    rates:\n", "    rod: {stretch_n: [1, 2]}\n    rates:\n", 1), "t.yaml"
        )


def test_a_rod_that_buckles_meets_no_target_and_holds_its_seed(configs: Path) -> None:
    model = loaded(configs, "{}")
    pressed = (0.0, 0.0, -1000.0)
    pose = model.forward((0.0,) * 9, pressed)
    assert not pose.stable
    assert model.forward((0.0,) * 9, (0.0, 0.0, 1.0)).stable
    answer = model.inverse(Target(tip_m=pose.tip_m, load_n=pressed), (0.0,) * 9)
    assert not answer.converged
    assert "stability" in answer.limited_by
    assert answer.actuation == (0.0,) * 9
