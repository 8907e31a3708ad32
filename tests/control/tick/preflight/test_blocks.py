"""Blocks of rows and ticks beside single ones: the same verdicts, findings and states."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.limits import followed, limit
from contid.control.tick.preflight import blocks, path, rows
from contid.control.tick.preflight.rows import Preflight
from contid.control.tick.preflight.ticks import SAMPLES, EveryTick, computes_every, run_ticks
from contid.errors import BadInputError
from contid.robot_file.load import LoadedFile, load_named
from contid.targets import Actuation
from contid.trajectory import read
from contid.trajectory.read import read_trajectory
from contid.trajectory.timed import Trajectory

Row = tuple[float, ...]


def finger_walk(wild: float) -> Iterator[Row]:
    """A spiral with noise, which bring the finger to all of its limits as ``wild`` goes from 0 to 1."""
    random = np.random.default_rng(5)
    for k in range(200):
        radius, angle = (2 + 62 * wild**4) * k / 200, 0.02 * k
        x, y = 20 + radius * math.sin(angle), 75 + radius * math.cos(angle)
        yield 0.04 * k, x + 10 ** (4.5 * wild - 4) * random.normal(), y


def arm_walk(wild: float) -> Iterator[Row]:
    for k in range(200):
        x, y = math.sin(0.01 * k), 1 - math.cos(0.013 * k)
        yield 0.05 * k, 4 + 400 * wild * x, 5 + 400 * wild * y, 260 - 20 * wild * x * x


def written(loaded: LoadedFile, names: str, walk: Iterator[tuple[float, ...]]) -> Trajectory:
    text = "\n".join([names, *(",".join(f"{each:.9f}" for each in row) for row in walk)])
    return read_trajectory(io.StringIO(text), "t.csv", loaded.driven)


def findings(loaded: LoadedFile, trajectory: Trajectory) -> list[tuple[int, str]]:
    try:
        Preflight(build_robot_configs(loaded, loaded.file.rate_hz)).trajectory(trajectory, "t.csv")
    except BadInputError as error:
        return [(each.line, each.message) for each in error.findings]
    return []


@pytest.mark.parametrize(
    ("name", "names", "walk"),
    [("finger", "t_s,x_mm,y_mm", finger_walk), ("trirack", "t_s,x_mm,y_mm,z_mm", arm_walk)],
)
def test_verdicts_are_those_of_single_ticks(
    name: str, names: str, walk: Callable[[float], Iterator[Row]], monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded = load_named(name)
    paths = [written(loaded, names, walk(wild)) for wild in (0.0, 0.7, 0.9, 1.0)]
    assert all(blocks.takes_blocks(each, build_robot_configs(loaded, loaded.file.rate_hz)) for each in paths)
    verdicts = [findings(loaded, each) for each in paths]
    for module in (path, rows):
        monkeypatch.setattr(module, "takes_blocks", lambda trajectory, configs: False)
    assert [findings(loaded, each) for each in paths] == verdicts
    kinds = {"fine" if not each else "fast" if "slow down" in each[-1][1] else "reach" for each in verdicts}
    assert kinds >= {"fine", "fast" if name == "finger" else "reach"}


def test_ticks_are_those_of_single_ones() -> None:
    loaded = load_named("finger")
    walks: list[list[Row]] = [[(0.0, 20.0, 80.0)], *([*finger_walk(wild)][:40] for wild in (0.0, 0.5, 1.0))]
    for walk in walks:
        trajectory = written(loaded, "t_s,x_mm,y_mm", iter(walk))
        for rate_hz, lead, tail in ((200.0, 0, 0), (137.3, 4, 10), (50.0, 400, 400), (200.0, 30, 0)):
            assert computes_every(trajectory, rate_hz)
            ticks = EveryTick(trajectory, rate_hz, lead, tail)
            single = run_ticks(trajectory, rate_hz, lead, tail, lambda samples: set(), SAMPLES)
            assert [ticks[number] for number in range(len(ticks))] == list(single)
            rows = trajectory.values_of_many(ticks.times_s)
            assert rows.tolist() == [trajectory.values_at(at) for at in ticks.times_s.tolist()]


def test_a_long_interval_is_sampled_and_takes_no_blocks() -> None:
    loaded = load_named("finger")
    slow = written(loaded, "t_s,x_mm,y_mm", iter([(0.0, 20.0, 80.0), (1.6, 20.1, 80.0)]))
    assert not computes_every(slow, 200.0)


def test_followed_counts_what_limit_returns_as_it_is() -> None:
    limits = build_robot_configs(load_named("finger"), 200.0)[0].limits
    random = np.random.default_rng(3)
    for scale in (0.5, 0.9, 1.05):
        steps = np.cumsum(random.uniform(-1, 1, (200, 2)) * scale * limits[0].change, axis=0)
        targets = 0.06 + np.cumsum(steps, axis=0)
        last: Actuation = (0.06, 0.06)
        last_steps: Actuation = (0.0, 0.0)
        count = 0
        for to in targets.tolist():
            pace = [new - old for new, old in zip(to, last, strict=True)]
            command, flags = limit(limits, last, last_steps, to, pace)
            if command != tuple(to) or any(flags):
                break
            last, last_steps, count = command, tuple(pace), count + 1
        assert followed(limits, (0.06, 0.06), (0.0, 0.0), targets) == count
    assert 0 < count < 200


def test_plain_lines_are_read_as_single_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    loaded = load_named("finger")
    good = [f"{0.01 * k:.6f},{20 + 1e-3 * k!r},{80 - 1e-3 * k}" for k in range(40)]
    wrong = [
        "0.2,1_0,3",
        "0.2,nan,3",
        "0.2,1,2,3",
        "0.1,20,80",
        ",,",
        "# a comment",
        "0.4,1e400,3",
        '0.4,"21",80',
    ]
    texts = [good, *([*good[:20], each, *good[20:]] for each in wrong)]

    def outcome(lines: list[str]) -> object:
        try:
            made = read_trajectory(io.StringIO("\n".join(["t_s,x_mm,y_mm", *lines])), "t.csv", loaded.driven)
        except BadInputError as error:
            return error.findings
        return made.rows.tolist(), list(made.lines)

    together = [outcome(each) for each in texts]
    monkeypatch.setattr(read, "plain_rows", lambda layout, lines, least_s: None)
    assert [outcome(each) for each in texts] == together
    monkeypatch.undo()
    monkeypatch.setattr(read, "LINES", 7)
    assert [outcome(each) for each in texts] == together
