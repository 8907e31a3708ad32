"""The limiter's kernel: inverses and bounded steps against SciPy, tendons against the balance of energy."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import REFUSED, TENSION, limit
from contid.control.tick.taut import limit_taut
from contid.kernels import load
from contid.kinematics.tendon.model import TendonModel
from contid.robot_file.load import parse_robot_file

#: Weights of progress along the line and of the preferred steps: ``contid/kernels/limiter/chord.hpp``.
PROGRESS, PREFERENCE = 1e-3, 1e-6


def inverse_of(matrix: np.ndarray, singular: float = 1e-15) -> np.ndarray:
    out = np.empty(matrix.shape[::-1])
    load("limiter").pseudo_inverse(np.ascontiguousarray(matrix), singular, out)
    return out


@pytest.mark.parametrize("rank", [0, 1, 2, 3, 6])
def test_inverses_meet_the_four_conditions_of_penrose(rank: int) -> None:
    rng = np.random.default_rng(rank)
    for _ in range(100):
        rows, columns = rng.integers(max(rank, 1), 13, 2)
        scale = 10.0 ** rng.uniform(-6.0, 6.0)
        left, right = rng.normal(size=(rows, rank)), rng.normal(size=(rank, columns))
        matrix = scale * left @ right
        inverse = inverse_of(matrix, 1e-9)
        for product, whole in ((matrix @ inverse @ matrix, matrix), (inverse @ matrix @ inverse, inverse)):
            assert np.abs(product - whole).max() <= 1e-8 * max(np.abs(whole).max(), 1e-300)
        for product in (matrix @ inverse, inverse @ matrix):
            assert np.abs(product - product.T).max() <= 1e-8


def test_small_singular_values_count_as_none() -> None:
    rng = np.random.default_rng(3)
    u, v = np.linalg.qr(rng.normal(size=(4, 4)))[0], np.linalg.qr(rng.normal(size=(6, 6)))[0]
    matrix = u @ np.diag([2.0, 1.0, 3e-6, 1e-6]) @ v[:4]
    expected = v[:3].T @ np.diag([0.5, 1.0, 1.0 / 3e-6]) @ u[:, :3].T
    assert inverse_of(matrix, 1e-6) == pytest.approx(expected, rel=1e-9, abs=1e-4)
    assert inverse_of(matrix.T, 1e-6) == pytest.approx(expected.T, rel=1e-9, abs=1e-4)


def test_what_is_not_a_number_raises() -> None:
    matrix = np.array([[1.0, math.nan], [0.0, 1.0]])
    with pytest.raises(ValueError, match="finite"):
        inverse_of(matrix)
    two, held = np.zeros(2), np.zeros(2, dtype=np.int8)
    with pytest.raises(ValueError, match="finite"):
        load("limiter").nearest_step(
            matrix, np.array([1.0, 0.0]), 1.0, two, 0.1, two, two - 1.0, two + 1.0, held, np.empty(2)
        )


@pytest.mark.parametrize("begin", [0, 1])
def test_the_nearest_step_is_that_of_scipy(begin: int) -> None:
    """From free axes, and from bounds of another problem."""
    rng = np.random.default_rng(1 + begin)
    for _ in range(200):
        rows, axes = (int(number) for number in rng.integers((2, 1), (10, 10)))
        slopes, asked = rng.normal(size=(rows, axes)), 0.3 * rng.normal(size=rows)
        along = rng.normal(size=rows)
        along /= np.linalg.norm(along)
        size, pace = float(np.linalg.norm(slopes)), float(rng.uniform(0.0, 3.0))
        low = rng.uniform(-1.0, 0.3, axes)
        high = low + rng.uniform(0.01, 1.0, axes)
        preferred = rng.normal(size=axes)
        held, step = rng.integers(-begin, begin + 1, axes).astype(np.int8), np.empty(axes)
        load("limiter").nearest_step(slopes, along, size, asked, pace, preferred, low, high, held, step)
        onto = np.outer(along, along)
        matrix = np.vstack(
            [(np.eye(rows) - onto) @ slopes, PROGRESS * along @ slopes, PREFERENCE * size * np.eye(axes)]
        )
        right = np.hstack(
            [(np.eye(rows) - onto) @ asked, PROGRESS * (pace + along @ asked), PREFERENCE * size * preferred]
        )
        best = lsq_linear(matrix, right, (low, high), method="bvls", tol=1e-14).x
        assert np.all((low <= step) & (step <= high))
        assert np.linalg.norm(matrix @ step - right) <= np.linalg.norm(matrix @ best - right) + 1e-9
        assert np.array_equal(held != 0, (held < 0) & (step == low) | (held > 0) & (step == high))


def config_of(configs: Path, name: str) -> RobotConfig:
    (config,) = build_robot_configs(parse_robot_file((configs / f"{name}.yaml").read_text(), name), 100.0)
    return config


@pytest.mark.parametrize("name", ["tendon3", "ftdcr_v4"])
def test_no_tendon_gets_slack_on_the_way_to_any_answer(configs: Path, name: str) -> None:
    """Answers anywhere in the limits of travel, and some that are no numbers; tensions by the energy."""
    config, rng = config_of(configs, name), np.random.default_rng(8)
    model = config.model
    assert isinstance(model, TendonModel)
    assert model.taut is not None
    assert model.statics is not None
    k, G = model.statics.tendon_n_per_m, model.geometry.pull_matrix
    # The energy of tendons and backbone is a sum of squares, whose least the bends have.
    roots = np.vstack([np.sqrt(k)[:, None] * G, np.diag(np.sqrt(np.repeat(model.statics.bending_nm, 2)))])
    last, steps, seen = config.rest, (0.0,) * len(config.rest), 0
    for count in range(1500):
        if count % 50 == 0:
            answer = tuple(rng.uniform(model.lower, model.upper).tolist())
            answer = (math.nan,) * len(answer) if count % 500 == 450 else answer
        limited = limit(config.limits, last, steps, answer, (0.0,) * len(last))
        after, flags = limit_taut(model.taut, config.limits, last, steps, answer, (0.0,) * len(last), limited)
        seen += any(flag & TENSION for flag in flags)
        assert all(flag & TENSION or a == b for flag, a, b in zip(flags, after, limited[0], strict=True))
        assert not math.isnan(answer[0]) or all(flag & REFUSED for flag in flags)
        moved = tuple(new - old for new, old in zip(after, last, strict=True))
        changed = np.subtract(moved, steps)
        for axis, step, change in zip(config.limits, moved, changed, strict=True):
            assert abs(step) <= axis.step * (1 + 1e-9)
            assert abs(change) <= axis.change * (1 + 1e-6)
        right = np.concatenate([np.sqrt(k) * after, np.zeros(G.shape[1])])
        bends = np.linalg.lstsq(roots, right, rcond=None)[0]
        tensions = model.statics.rest_n + k * (np.array(after) - G @ bends)
        assert tensions.min() >= model.statics.floor_n - 1e-4
        assert tensions.max() <= model.statics.limit_n + 1e-4
        last, steps = after, moved
    assert seen > 100


@pytest.mark.parametrize("name", ["finger", "cbha", "trirack2", "stiffflop2", "tendon3", "ftdcr_v4"])
def test_what_stands_is_what_the_limiters_answer(configs: Path, name: str) -> None:
    """The chain of limiters leaves a command alone that stands: it need not be asked."""
    config, rng = config_of(configs, name), np.random.default_rng(4)
    still = (0.0,) * len(config.rest)
    for _ in range(200):
        at = np.array(config.rest) + rng.normal(size=len(still)) * [each.step for each in config.limits]
        here = tuple(at.tolist())
        limited = limit(config.limits, here, still, here, still)
        assert limited == (here, (0,) * len(here))
        if config.taut is not None:
            assert limit_taut(config.taut, config.limits, here, still, here, still, limited) == limited
