"""Simulated devices through their bus: limits, settling, determinism, scripted faults, the journal."""

from __future__ import annotations

import itertools
import json
import math
from typing import Any

import pytest

from contid.control.engine.cycle import VirtualClock
from contid.errors import DeviceError, DeviceLostError
from contid.hal import AxisOnBus, Rest
from contid_drivers.sim import DRIVER
from contid_drivers.sim.options import FaultKind, SimAxisOptions, SimBusOptions
from tests.support.sim_faults import advance, heal, inject

TICK = 2.0 * math.pi / 4096.0
BAR = 1e5


class Rig:
    """One bus, one clock, 200 Hz."""

    def __init__(self, *axes, names=None, **bus):
        self.clock = VirtualClock(50.0)
        names = names or [f"r.{letter}" for letter in "abcdef"[: len(axes)]]
        on_bus = [AxisOnBus(name, SimAxisOptions(**axis)) for name, axis in zip(names, axes, strict=True)]
        self.bus: Any = DRIVER.open_bus("bus", SimBusOptions(**bus), on_bus, self.clock)

    def start(self):
        self.bus.open()
        self.bus.exchange({})
        self.bus.enable(self.bus.axes)
        return self

    def run(self, seconds, step_s=0.005, **goals):
        commands = {f"r.{axis}": goal for axis, goal in goals.items()}
        out = []
        for _ in range(max(1, round(seconds / step_s))):
            self.clock.sleep(step_s)
            out.append(self.bus.exchange(commands))
        return out

    def value(self, axis="r.a"):
        advance(self.bus)
        return self.bus.devices[axis].motion.value


# -- motion ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "goal", "quantum"),
    [
        ({"device": "servo", "noise_deg": 0}, 12.345, TICK),
        ({"device": "servo", "noise_deg": 0, "start_deg": -3000}, -40.0, TICK),
        ({"device": "motor"}, -7.7, 2 * math.pi / 4776),
        ({"device": "motor", "counts_per_rev": 1000}, 5.0, 2 * math.pi / 1000),
        ({"device": "regulator", "noise_bar": 0}, 1.234 * BAR, 3 * BAR / 4095),
    ],
)
def test_settles_at_the_goal_within_one_quantum(options, goal, quantum):
    last = Rig(options).start().run(4.0, a=goal)[-1]["r.a"]
    assert last.value == pytest.approx(goal, abs=quantum)
    assert last.value / quantum == pytest.approx(round(last.value / quantum), abs=1e-6)
    assert last.velocity == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("tau_ms", [0, 20])
def test_velocity_and_acceleration_stay_in_their_limits(tau_ms):
    servo = {
        "device": "servo", "velocity_deg_s": 300, "acceleration_deg_s2": 2000,
        "response_ms": tau_ms, "noise_deg": 0,
    }  # fmt: skip
    rig = Rig(servo).start()
    positions, dt = [], 0.002
    for goal in (4.0, -2.0, -1.9, 3.0):  # turned round in full motion, too
        for _ in range(200):
            rig.run(dt, step_s=dt, a=goal)
            positions.append(rig.value())
    speeds = [(b - a) / dt for a, b in itertools.pairwise(positions)]
    pulls = [(b - a) / dt for a, b in itertools.pairwise(speeds)]
    assert max(map(abs, speeds)) == pytest.approx(math.radians(300), rel=1e-6)
    assert max(map(abs, pulls)) <= math.radians(2000) * (1 + 1e-6)


def test_a_motor_follows_a_stream_as_its_board_does():
    """The set-point goes on with the commands instead of stopping at each: it lags by its response only."""
    rig = Rig({"device": "motor", "velocity_deg_s": 470, "acceleration_deg_s2": 5200}).start()
    at, speed, period_s, worst = 0.0, 0.0, 0.01, 0.0
    for tick in range(600):
        wish = 8.0 * math.copysign(1.0, math.sin(0.07 * tick + math.sin(0.031 * tick)))
        speed += min(max(wish - speed, -0.72), 0.72)  # 72 rad/s2: 900 mm/s2 on a pinion of 25 mm
        at += speed * period_s
        rig.run(period_s, step_s=period_s, a=at)
        worst = max(worst, abs(rig.value() - (at + speed * period_s)))
    assert (
        worst < 0.25
    )  # 3 mm, with jumps of the acceleration; one that stops at each command is 17 mm behind
    rig.run(1.0, a=at)
    assert rig.value() == pytest.approx(at, abs=2e-3)


def test_regulator_keeps_slew_ceiling_and_floor():
    options = {
        "device": "regulator",
        "slew_bar_s": 2.0,
        "ceiling_bar": 1.5,
        "noise_bar": 0,
        "response_ms": 30,
    }
    rig = Rig(options).start()
    rising = [rig.value() for _ in rig.run(0.0)]
    for _ in range(200):
        rig.run(0.005, a=9 * BAR)
        rising.append(rig.value())
    slopes = [(b - a) / 0.005 for a, b in itertools.pairwise(rising)]
    assert max(slopes) <= 2.0 * BAR * (1 + 1e-9)
    assert max(rising) <= 1.5 * BAR
    assert rig.run(1.0, a=-BAR)[-1]["r.a"].value == 0.0


def test_venting_falls_at_its_rate_and_hold_closes():
    options = {"device": "regulator", "start_bar": 2, "vent_bar_s": 0.5, "response_ms": 0, "noise_bar": 0}
    rig = Rig(options, options).start()
    rig.bus.disable(["r.a"], Rest.VENT)
    rig.bus.disable(["r.b"], Rest.HOLD)
    rig.clock.sleep(1.0)
    assert rig.value("r.a") == pytest.approx(1.5 * BAR)
    rig.clock.sleep(10.0)
    assert rig.value("r.a") == 0.0
    assert rig.value("r.b") == 2 * BAR


def test_the_pace_of_exchanges_does_not_change_the_motion():
    fine, coarse = (Rig({"device": "servo"}, watchdog_ms=1000).start() for _ in range(2))
    for one in (fine, coarse):
        one.bus.exchange({"r.a": 3.0})
    fine.run(0.25, step_s=0.001)
    coarse.run(0.25, step_s=0.25)
    assert fine.value() == pytest.approx(coarse.value(), abs=1e-9)


# -- readings --------------------------------------------------------------------------------------------


def campaign(seed):
    names = ["r.a", "r.b", "r.c"]
    rig = Rig(
        {"device": "servo"}, {"device": "motor"}, {"device": "regulator"}, names=names, seed=seed,
        faults=[{"at_s": 0.3, "axis": "r.a", "kind": "silent", "for_s": 0.05}, {"at_s": 0.5, "kind": "late"}],
    ).start()  # fmt: skip
    return repr([rig.run(0.005, a=math.sin(k / 20), b=k / 100, c=500.0 * k) for k in range(200)]).encode()


def test_one_seed_gives_the_same_bytes_and_another_does_not():
    assert campaign(7) == campaign(7)
    assert campaign(7) != campaign(8)


def test_axes_do_not_share_their_noise():
    """Adding an axis changes no other axis: the same finger in a bigger hand behaves the same."""
    alone = Rig({"device": "servo"}).start().run(0.5, a=1.0)
    with_other = Rig({"device": "servo"}, {"device": "servo"}).start().run(0.5, a=1.0)
    assert [s["r.a"] for s in alone] == [s["r.a"] for s in with_other]


def test_load_draws_current_warms_and_lowers_the_voltage():
    rig = Rig({"device": "servo"}).start()
    rest = rig.run(0.1)[-1]["r.a"]
    assert (rest.effort, rest.temperature_c, rest.voltage_v) == (pytest.approx(0.0, abs=0.01), 25.0, 5.0)
    moving = rig.run(0.3, a=100.0)[-1]["r.a"]
    assert 0.3 < moving.effort < 1.47
    assert moving.voltage_v < 5.0
    hot = rig.run(40.0, step_s=0.1, a=1500.0)[-1]["r.a"]
    assert 26.0 <= hot.temperature_c < 60.0


def test_free_motion_never_overloads_a_device():
    for device in ("servo", "motor"):
        rig = Rig({"device": device}).start()
        for k in range(20):
            rig.run(0.2, a=(-1.0) ** k * 50.0)
        assert rig.run(0.0)[-1]["r.a"].fault == ""


# -- faults ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("device", "message"), [("servo", "overload"), ("motor", "stalled")])
def test_a_held_shaft_saturates_the_current_then_drops_the_torque(device, message):
    rig = Rig({"device": device, "overload_s": 0.4, "current_limit_ma": 800}).start()
    rig.run(0.2, a=1.0)
    inject(rig.bus, FaultKind.STALL, "r.a")
    held = rig.value()
    saturated = rig.run(0.3, a=30.0)[-1]["r.a"]
    assert saturated.effort == 0.8
    assert saturated.fault == ""
    dropped = rig.run(0.6, a=30.0)[-1]["r.a"]
    assert dropped.fault == message
    assert dropped.effort == 0.0
    heal(rig.bus, FaultKind.STALL, "r.a")
    rig.run(1.0, a=30.0)
    assert rig.value() == held


def test_stale_data_is_valid_and_grows_old():
    rig = Rig({"device": "servo"}, {"device": "servo"}).start()
    before = rig.run(0.005)[-1]["r.a"]
    inject(rig.bus, FaultKind.STALE, "r.a", for_s=0.1)
    samples = rig.run(0.05, a=2.0)[-1]
    assert samples["r.a"].valid
    assert (samples["r.a"].value, samples["r.a"].time_s) == (before.value, before.time_s)
    assert samples["r.a"].age_s == pytest.approx(0.05)
    assert samples["r.b"].age_s == 0.0
    assert rig.run(0.1, a=2.0)[-1]["r.a"].age_s == 0.0


def test_a_late_reply_delays_the_exchange_and_ages_its_sample():
    rig = Rig({"device": "servo"}, latency_ms=1.0).start()
    inject(rig.bus, FaultKind.LATE, for_s=0.001, delay_ms=30.0)
    before = rig.clock.now()
    sample = rig.bus.exchange({})["r.a"]
    assert rig.clock.now() - before == pytest.approx(0.031)
    assert sample.age_s == pytest.approx(0.031)
    assert rig.bus.exchange({})["r.a"].age_s == pytest.approx(0.001)


def test_a_campaign_in_the_file_happens_at_its_times(tmp_path):
    journal = tmp_path / "journal.jsonl"
    rig = Rig(
        {"device": "servo"}, {"device": "servo"}, journal_file=str(journal), watchdog_ms=100,
        faults=[
            {"at_s": 0.2, "axis": "r.a", "kind": "silent", "for_s": 0.05},
            {"at_s": 0.4, "axis": "r.b", "kind": "overload"},
            {"at_s": 0.6, "kind": "lost", "for_s": 0.3},
        ],
    ).start()  # fmt: skip
    samples = rig.run(0.595)
    silent = [k for k, s in enumerate(samples, start=1) if not s["r.a"].valid]
    assert silent[0] * 0.005 == pytest.approx(0.2, abs=0.0051)
    assert len(silent) == pytest.approx(10, abs=1)
    assert samples[-1]["r.b"].fault == "overload"
    with pytest.raises(DeviceLostError):
        rig.run(0.05)
    rig.clock.sleep(0.5)
    rig.bus.open()
    rig.bus.close()

    lines = [json.loads(line) for line in journal.read_text().splitlines()]
    at = {line["event"]: line["t_s"] - 50.0 for line in lines}
    assert [line["event"] for line in lines] == [
        "open", "enable", "silent begins", "silent ends", "overload begins", "lost begins", "trip",
        "lost ends", "open", "close",
    ]  # fmt: skip
    assert at["silent begins"] == pytest.approx(0.2)
    assert at["lost begins"] == pytest.approx(0.6)
    # 100 ms after the last completed exchange, although nothing advanced the bus before 1.1 s.
    assert 0.69 < at["trip"] <= 0.7
    trip = next(line for line in lines if line["event"] == "trip")
    assert trip["subject"] == "r.a"
    assert trip["axes"]["r.a"]["rest"] == "hold"
    assert "watchdog" in trip["axes"]["r.a"]["fault"]
    assert trip["axes"]["r.b"]["fault"] == "overload"


def test_without_a_journal_no_file_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Rig({"device": "servo"}).start().bus.close()
    assert list(tmp_path.iterdir()) == []


def test_a_journal_that_cannot_be_written_is_named(tmp_path):
    rig = Rig({"device": "servo"}, journal_file=str(tmp_path / "missing" / "j.jsonl"))
    with pytest.raises(DeviceError, match=r"bus: cannot write journal_file .*missing"):
        rig.bus.open()


@pytest.mark.parametrize(
    ("options", "powered"), [({"on_watchdog": "relax"}, False), ({"on_watchdog": "hold"}, True), ({}, True)]
)
def test_the_watchdog_takes_the_configured_rest(options, powered):
    rig = Rig({"device": "servo", **options}, watchdog_ms=60).start()
    rig.run(0.1, a=5.0)
    rig.clock.sleep(0.0601)
    advance(rig.bus)
    device = rig.bus.devices["r.a"]
    assert not device.on
    assert (device.rest is Rest.HOLD) == powered
