"""The tip in motion: recovered from commands and noisy tips of a plant that another integrator moves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid_identify.ahead import ahead, goes_on, memory_of, predicted_tips
from contid_identify.answer import CommandedTrace
from contid_identify.moved_on import payload_of, recover
from contid_identify.prediction import lines, predicted
from contid_identify.printed import motion_lines
from contid_identify.tip_fit.trace_rows import LoadedTrace
from contid_identify.tip_motion import AheadError, TipMotion
from contid_identify.tip_motion_file import read_tip_motion, write_tip_motion
from contid_identify.tip_motion_fit import fit_tip_motion

pytestmark = pytest.mark.slow

PERIOD_S = 0.02
HZ, RATIO, DELAY_S = 1.5, 0.25, 0.13


def commands(seed: int, duration_s: float = 30.0) -> Array:
    """Sums of sines on two axes, smooth at the start."""
    draw = np.random.default_rng(seed)
    at_s = np.arange(0.0, duration_s, PERIOD_S, dtype=np.float64)
    lines = [
        draw.uniform(0.2, 1.0) * np.sin(2.0 * np.pi * draw.uniform(0.1, 1.6) * at_s + draw.uniform(0, 6.28))
        for _ in range(20)
    ]
    ramp = np.minimum(at_s, 1.0)[:, None]
    columns = np.column_stack([sum(lines[:10]), sum(lines[10:])])
    return np.asarray(0.8 * ramp * columns / np.abs(columns).max(axis=0))


def plant(sent: Array, load_kg: float = 0.0, delay_s: float = DELAY_S, zero: float = 0.0) -> Array:
    """Tips at the ticks [m]: semi-implicit Euler of a swing with small steps, then two bends of one arc."""
    parts, hz = 20, HZ * np.exp(-2.0 * load_kg)
    step_s, rate = PERIOD_S / parts, 2.0 * np.pi * hz
    late = round(delay_s / step_s)
    fine = np.repeat(sent, parts, axis=0)
    fine = np.concatenate([np.repeat(fine[:1], late, axis=0), fine])[: len(fine)]
    x, v, out = fine[0].copy(), np.zeros(2), []
    for k, target in enumerate(fine):
        if k % parts == 0:
            out.append(x.copy())
        v += step_s * (rate**2 * (target - x) - 2.0 * RATIO * rate * v)
        x += step_s * v
    bends = 0.6 * np.array(out) + zero
    bend = np.maximum(np.linalg.norm(bends, axis=1, keepdims=True), 1e-9)
    side = (1.0 - np.cos(bend)) / bend**2 * bends
    tip = 0.2 * np.column_stack([side, np.sin(bend) / bend])
    return np.asarray(tip - np.array([0.0, 0.0, 0.05 * load_kg]) + 0.1 * load_kg * tip)


def trace_of(seed: int, load_kg: float = 0.0, duration_s: float = 30.0, **changes: float) -> CommandedTrace:
    sent = commands(seed, duration_s)
    noise = np.random.default_rng(seed + 1000).normal(0.0, 3e-4, (len(sent), 3))
    tips = plant(sent, load_kg, **changes) + noise
    return CommandedTrace(PERIOD_S, sent, np.arange(float(len(sent))) * PERIOD_S, tips, f"seed {seed}")


@pytest.fixture(scope="module")
def model() -> TipMotion:
    traces = [LoadedTrace(trace_of(1, 0.0), 0.0), LoadedTrace(trace_of(2, 0.2), 0.2)]
    with pytest.MonkeyPatch.context() as few:
        # Fewer centres cost less; what is remembered has its own tests.
        few.setattr("contid_identify.remembered.MOST", 200)
        return fit_tip_motion("arm", ("a", "b"), traces, None, "a test")


def test_delay_swing_and_other_commands(model: TipMotion) -> None:
    assert model.delay_s == pytest.approx(DELAY_S, abs=0.002)
    assert model.frequency_hz == pytest.approx(HZ, rel=0.02)
    assert model.ratio == pytest.approx(RATIO, rel=0.2)
    assert model.softer_per_kg == pytest.approx(2.0, rel=0.2)
    assert 0.0 < model.halves.delay_s < 0.004
    assert 0.0 < model.halves.frequency < 0.03
    assert 0.0 < model.halves.ratio < 0.2
    assert any("all together: delay +- " in line for line in motion_lines(model))
    other = trace_of(5)
    off = np.linalg.norm(model.predict(other.sent, PERIOD_S) - other.measured, axis=1)
    # 0.3 mm of noise on each of three components is 0.52 mm; the tip moves by 0.1 m.
    assert np.sqrt((off**2).mean()) < 1.5e-3
    assert 0.85 < (off <= model.open_loop.radius_m).mean() <= 1.0
    assert model.errors[0].rmse_m <= 1.1 * model.open_loop.rmse_m


def exact_plant(sent: Array, delay_s: float) -> Array:
    """`plant` without load, by scipy's discretisation: its steps shift frequencies by less than intervals."""
    from scipy.signal import cont2discrete, lfilter

    parts, rate = 20, 2.0 * np.pi * HZ
    above, below, step_s = cont2discrete(
        ([rate**2], [1.0, 2.0 * RATIO * rate, rate**2]), PERIOD_S / parts, method="zoh"
    )
    late = round(delay_s / step_s)
    fine = np.repeat(sent, parts, axis=0)
    fine = np.concatenate([np.repeat(fine[:1], late, axis=0), fine])[: len(fine)]
    swung = fine[0] + lfilter(above.ravel(), below, fine - fine[0], axis=0)
    bends = 0.6 * swung[::parts]
    bend = np.maximum(np.linalg.norm(bends, axis=1, keepdims=True), 1e-9)
    side = (1.0 - np.cos(bend)) / bend**2 * bends
    return np.asarray(0.2 * np.column_stack([side, np.sin(bend) / bend]))


@pytest.mark.campaign
@pytest.mark.timeout(1800)
def test_intervals_hold_the_truth() -> None:
    """24 plants with 0.3 mm of noise: delay, frequency and damping, and their 95 % intervals."""
    held, off = [], []
    for seed in range(24):
        delay_s = 1e-3 * round(np.random.default_rng(5000 + seed).uniform(20.0, 200.0))
        sent = commands(seed, 40.0)
        tips = exact_plant(sent, delay_s) + np.random.default_rng(seed).normal(0.0, 3e-4, (len(sent), 3))
        trace = CommandedTrace(PERIOD_S, sent, np.arange(float(len(sent))) * PERIOD_S, tips)
        model = fit_tip_motion("arm", ("a", "b"), [LoadedTrace(trace)], None, "")
        errors = [
            model.delay_s.mean() - delay_s,
            model.frequency_hz.mean() / HZ - 1.0,
            model.ratio.mean() / RATIO - 1.0,
        ]
        held.append(np.abs(errors) <= [model.halves.delay_s, model.halves.frequency, model.halves.ratio])
        off.append(np.abs(errors))
        print(seed, np.array(errors), model.halves, np.sum(held, axis=0), flush=True)
    text = f"off at most {np.max(off, axis=0)}, held {np.sum(held, axis=0)} of {len(held)}"
    print(text)
    assert (np.max(off, axis=0) <= [0.002, 0.02, 0.2]).all(), text
    assert np.sum(held) >= 62, text


def test_a_payload_from_motion(model: TipMotion) -> None:
    found = payload_of(model, trace_of(7, 0.1, 12.0))
    assert found.value == pytest.approx(0.1, abs=0.01)
    assert found.half < 0.03
    with pytest.raises(ContidError, match="--load-g"):
        payload_of(replace(model, loads_kg=(0.0, 0.0)), trace_of(7))
    with pytest.raises(ContidError, match="record longer"):
        payload_of(model, trace_of(7, 0.1, 3.0))


def test_a_payload_among_errors_that_last(model: TipMotion) -> None:
    """12 mm of a disturbance that lasts for a second: its innovations are small, and intervals hold."""
    lasting = replace(model, memory=np.array([0.98, 0.0]))
    found, plain = [], []
    for seed in range(12):
        trace, draw = trace_of(40 + seed, 0.1, 10.0), np.random.default_rng(seed)
        off = np.zeros_like(trace.measured)
        for k in range(1, len(off)):
            off[k] = 0.98 * off[k - 1] + draw.normal(0.0, 12e-3 * np.sqrt(1.0 - 0.98**2), 3)
        disturbed = replace(trace, measured=trace.measured + off)
        found.append(payload_of(lasting, disturbed))
        plain.append(payload_of(replace(model, memory=np.zeros(2)), disturbed))
    errors, others = (np.array([each.value - 0.1 for each in part]) for part in (found, plain))
    assert np.sqrt((errors**2).mean()) < 0.75 * np.sqrt((others**2).mean())
    held = [abs(error) <= each.half for error, each in zip(errors, found, strict=True)]
    assert sum(held) >= 10


def test_a_prediction_ahead_uses_no_later_tip(model: TipMotion) -> None:
    """30 ms ahead at steps of 20 ms: the tip 20 ms before is later than 30 ms before."""
    trace = trace_of(5, duration_s=6.0)
    found = []
    for moved_m in (0.0, 0.01):
        measured = trace.measured.copy()
        measured[150] += moved_m
        tips = predicted_tips(model, trace.sent, PERIOD_S, trace.at_s, measured, 0.0)
        errors, known = ahead(model, tips, 0.03)
        assert known[100:].all()
        found.append(tips.errors_m - errors)
    assert np.allclose(found[0][:152], found[1][:152])
    assert not np.allclose(found[0][152], found[1][152])


def test_recovery_after_a_change(model: TipMotion) -> None:
    changed = trace_of(9, delay_s=0.05, zero=0.03)
    found = recover(model, changed, 18.0)
    assert found.later_s.value == pytest.approx(-0.08, abs=0.005)
    assert found.after.rmse_m < 0.25 * found.zeroed.rmse_m < found.before.rmse_m
    assert found.holds
    tips = predicted_tips(model, changed.sent, PERIOD_S, changed.at_s, changed.measured, 0.0)
    judged = predicted(model, tips)
    assert not judged.holds
    assert "has changed" in list(lines(model, judged, None, None))[-1]
    with pytest.raises(ContidError, match="it must go on"):
        recover(model, changed, 28.0)


def test_a_slow_tracker_does_not_make_the_robot_look_changed(model: TipMotion) -> None:
    """At 8 Hz no prediction can be judged; that is not a robot that changed."""
    slow = trace_of(5)
    slow = slow.picked(np.arange(0, len(slow.at_s), 6))
    tips = predicted_tips(model, slow.sent, PERIOD_S, slow.at_s, slow.measured, 0.0)
    with pytest.raises(ContidError, match="tracker of 10 Hz or more"):
        predicted(model, tips)


def test_what_was_not_judged_is_null_in_the_file(model: TipMotion, tmp_path: Path) -> None:
    file, unjudged = tmp_path / "m.json", AheadError(0.3, float("nan"), float("nan"))
    write_tip_motion(replace(model, errors=(unjudged, model.open_loop)), file)
    assert "NaN" not in file.read_text()
    assert np.isnan(read_tip_motion(file).errors[0].rmse_m)


def test_recovery_from_as_few_seconds_as_the_option_allows(model: TipMotion) -> None:
    assert recover(model, trace_of(9, delay_s=0.05, zero=0.03), 4.0).later_s.value < 0.0


def test_outside_of_the_recordings_nothing_grows(model: TipMotion) -> None:
    far = np.full((200, 2), 30.0)
    far[:100] = 0.0
    assert np.linalg.norm(model.predict(far, PERIOD_S), axis=1).max() < 0.5
    assert model.outside(far, PERIOD_S, np.arange(200, dtype=np.float64) * PERIOD_S) > 0.3


def test_errors_go_on_by_their_recursion() -> None:
    draw, errors = np.random.default_rng(3), np.zeros((4000, 3))
    for k in range(1, len(errors)):
        errors[k] = 0.9 * errors[k - 1] + draw.normal(0.0, 1.0, 3)
    weights = goes_on(memory_of([errors], 0.02), 5)
    assert weights.sum() == pytest.approx(0.9**5, abs=0.05)


def test_the_file_holds_every_number(model: TipMotion, tmp_path: Path) -> None:
    file = tmp_path / "m.json"
    write_tip_motion(model, file)
    sent = commands(11, 5.0)
    again = read_tip_motion(file)
    assert np.array_equal(
        again.predict(sent, PERIOD_S, load_kg=0.1), model.predict(sent, PERIOD_S, load_kg=0.1)
    )
    assert again.errors == model.errors
    assert again.halves == model.halves
    text = file.read_text()
    for bad, message in (
        ("{}", "format"),
        ("nothing", "no file of a tip"),
        (text.replace('"degree": ', '"degree": 1'), "degree"),
        (text.replace('"centre"', '"center"'), "centre"),
        (text.replace('"memory": [', '"memory": [NaN,'), "finite"),
    ):
        file.write_text(bad)
        with pytest.raises(ContidError, match=message):
            read_tip_motion(file)


def test_commands_of_another_robot_are_refused(model: TipMotion) -> None:
    with pytest.raises(ContidError, match="needed"):
        model.predict(np.zeros((10, 3)), PERIOD_S)
    with pytest.raises(ContidError, match="finite"):
        model.predict(np.full((10, 2), np.nan), PERIOD_S)
