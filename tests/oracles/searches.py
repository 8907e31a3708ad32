"""Answers of searches for targets out of reach, with the best that scipy finds: ``rod-searches.json``.

``python -m tests.oracles.searches --write`` draws targets as `tests.oracles.bounded` does, for arms of one
and of two sections, as shipped and heavy on a tilted base, for the control loop and for thorough searches. A
row holds the kernel's answer and the least error of trf and SLSQP from many starts on poses of the branch; a
test holds that a search ends as near, and takes the same way there.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from contid.kinematics.cosserat.engine import InverseAnswer, Limits, RodSolver
from contid.kinematics.cosserat.model import CosseratModel
from contid.kinematics.cosserat.section import Rod
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import load_named
from contid.targets import Vec3
from tests.oracles.bounded import BOX, DENSITY, GRAM_N, TILTED, Case, best_of_scipy

FILE = Path(__file__).parents[1] / "reference" / "rod-searches.json"
#: Rows of each arm for the control loop, and thorough ones; starts of scipy.
BRIEF, THOROUGH, STARTS = 10, 3, 5
#: Targets [mm] that the arm gets to, or next to, from rest under 5 g, but not straight from a start [bar].
FORKED = (
    ([4.218, -19.874, 18.585], [0.699, 0.175, 0.466, 0.531, 0.854, 1.479]),
    ([2.0806, 29.5782, 29.0415], [0.4307, 1.372, 1.423, 0.942, 0.4155, 0.0074]),
    ([-22.3773, 39.1604, 15.9996], [1.3597, 0.794, 0.1117, 0.4099, 1.3861, 0.8266]),
)
#: Reachable rows of each kind and load, draws for these, and iterations of a descent from the seed.
HARD, DRAWS, ONE_DESCENT = 3, 400, 61


def arms() -> list[CosseratModel]:
    """One section and two as shipped, and both with the weight of silicone on a tilted base."""
    found = []
    for name in ("stiffflop1", "stiffflop2"):
        (robot,) = load_named(name).file.robots.values()
        assert isinstance(robot, Cosserat)
        sections = [s.model_copy(update={"density_kg_m3": DENSITY}) for s in robot.geometry.sections]
        geometry = robot.geometry.model_copy(update={"sections": sections})
        heavy = robot.model_copy(update={"geometry": geometry, "down": TILTED})
        found += [CosseratModel(robot), CosseratModel(heavy)]
    return found


def solve(solvers: dict[tuple[int, bool], RodSolver], row: dict[str, Any]) -> InverseAnswer:
    """The kernel's answer for a row; ``solvers`` of `solvers_of`."""
    return solvers[row["arm"], row["thorough"]].inverse(
        _vec(row["tip"]),
        _maybe(row.get("mid")),
        _maybe(row.get("direction")),
        _vec(row["force"]),
        row["seed"],
    )


def solvers_of(models: list[CosseratModel]) -> dict[tuple[int, bool], RodSolver]:
    """By number of an arm and whether searches are thorough; the last arm has three sections."""
    setups = [model.setup for model in models]
    shipped = setups[2]
    parts = (shipped.rod.sections[0], *shipped.rod.sections)
    ends = [
        np.tile(end[:3], 3) for end in (shipped.limits.lower, shipped.limits.upper, shipped.limits.centre)
    ]
    setups.append(replace(shipped, rod=Rod(parts), limits=Limits(*ends)))
    return {
        (k, thorough): RodSolver(replace(setup, thorough=thorough))
        for k, setup in enumerate(setups)
        for thorough in (False, True)
    }


def drawn(models: list[CosseratModel], seed: int = 5) -> list[dict[str, Any]]:
    """Rows with targets [mm] that are not met, their answers, and the best of scipy [mm]."""
    solvers, rows = solvers_of(models), []
    for k, model in enumerate(models):
        rng = np.random.default_rng([seed, k])
        low, high = model.setup.limits.lower, model.setup.limits.upper
        left = {False: BRIEF, True: THOROUGH if len(low) > 3 else 1}
        while any(left.values()):
            thorough = not left[False]
            force = rng.normal(size=3)
            force *= float(rng.choice([5.0, 10.0])) * GRAM_N / np.linalg.norm(force)
            row: dict[str, Any] = {
                "arm": k,
                "thorough": thorough,
                "tip": (model.setup.rod.reach * rng.uniform(*BOX)).round(4).tolist(),
                "force": force.round(5).tolist(),
                "seed": rng.uniform(low, high).round(4).tolist(),
            }
            found = solve(solvers, row)
            if found.met or not found.stable:
                continue
            left[thorough] -= 1
            case = Case(model, np.array(row["tip"]), _vec(row["force"]), np.array(row["seed"]), False)
            row["best_mm"] = round(best_of_scipy(case, STARTS)[0], 4)
            row["answer"] = found._asdict()
            rows.append(row)
            print(k, thorough, found.residual_mm, row["best_mm"], found.iterations, flush=True)
    return rows


def forked(models: list[CosseratModel]) -> list[dict[str, Any]]:
    """Thorough rows that search beside an answer, and three sections; without scipy ``best_mm`` is 0."""
    solvers = solvers_of(models)
    rows: list[dict[str, Any]] = []
    for tip, seed in FORKED:
        rows.append({"arm": 2, "thorough": True, "tip": tip, "force": [0.0, 0.0, 5.0 * GRAM_N], "seed": seed})
    rng, reach = np.random.default_rng(4), solvers[4, False].setup.rod.reach
    for k in range(BRIEF):
        force = rng.normal(size=3) * 0.4 * GRAM_N * (5.0 if k % 2 else 2.0)
        rows.append({
            "arm": 4, "thorough": False, "tip": (reach * rng.uniform(*BOX)).round(4).tolist(),
            "force": force.round(5).tolist(), "seed": rng.uniform(0.0, 1.5, 9).round(4).tolist(),
        })  # fmt: skip
    for row in rows:
        found = solve(solvers, row)
        row |= {"best_mm": 0.0, "answer": found._asdict()}
        print(row["arm"], found.residual_mm, found.met, found.stable, found.iterations, flush=True)
    return [row for row in rows if row["answer"]["stable"]]


def reachable(models: list[CosseratModel], seed: int = 8) -> list[dict[str, Any]]:
    """Rows with poses of other pressures, by every kind of target, that take more than one descent."""
    solvers, rows = solvers_of(models), []
    for k, model in enumerate(models):
        rng = np.random.default_rng([seed, k])
        low, high = model.setup.limits.lower, model.setup.limits.upper
        for kind in ("tip", "mid", "direction") if len(low) > 3 else ("tip",):
            for grams in (0.0, 5.0, 10.0):
                left = HARD
                for _ in range(DRAWS):
                    force = rng.normal(size=3)
                    force *= grams * GRAM_N / np.linalg.norm(force)
                    at = solvers[k, False].forward(rng.uniform(low, high).tolist(), _vec(force.tolist()))
                    row: dict[str, Any] = {
                        "arm": k,
                        "thorough": False,
                        "tip": np.round(at.tip_mm, 6).tolist(),
                        "mid": np.round(at.mid_mm, 6).tolist() if kind == "mid" else None,
                        "direction": list(at.rotation[2::3]) if kind == "direction" else None,
                        "force": force.round(5).tolist(),
                        "seed": rng.uniform(low, high).round(4).tolist(),
                    }
                    found = solve(solvers, row)
                    if not at.stable or not found.stable or found.iterations <= ONE_DESCENT:
                        continue
                    row |= {"best_mm": 0.0, "answer": found._asdict()}
                    rows.append(row)
                    print(k, kind, grams, found.residual_mm, found.iterations, flush=True)
                    left -= 1
                    if not left:
                        break
    return rows


def _maybe(values: list[float] | None) -> Vec3 | None:
    return None if values is None else _vec(values)


def _vec(values: list[float]) -> Vec3:
    x, y, z = values
    return x, y, z


def main() -> None:
    """Print rows, and write them with ``--write``."""
    parser = argparse.ArgumentParser(prog="python -m tests.oracles.searches")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    rows = [*drawn(arms()), *reachable(arms()), *forked(arms())]
    if given.write:
        FILE.write_text("[\n" + ",\n".join(json.dumps(row) for row in rows) + "\n]\n", encoding="utf-8")


if __name__ == "__main__":
    main()
