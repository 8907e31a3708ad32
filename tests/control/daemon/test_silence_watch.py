"""A control process that stands still is reported and killed; a slow or a preparing one is not."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import pytest

from contid.control.daemon.silence_watch import Activity, ProcessActivity, Silence, SilenceWatch
from tests.control.daemon.ended_control import LIBRARY, at_start, control_of, ended
from tests.support.daemons import HERE, armed, states
from tests.support.daemons import fast_daemon as daemon
from tests.support.waiting import until

LOOK_S = 0.02


def looks(
    watch: SilenceWatch, ticks: Iterable[int], preparing: bool = False, every_s: float = LOOK_S
) -> list[Silence]:
    """What a watch finds when the ticks that are complete are these, one look after the other."""
    return [watch.look(number, preparing, 100.0 + every_s * at) for at, number in enumerate(ticks)]


def watch_of(activity: Activity = Activity.GOES_ON, rate_hz: float = 200.0) -> SilenceWatch:
    return SilenceWatch(rate_hz, lambda: activity)


@pytest.mark.parametrize("activity", [Activity.GOES_ON, Activity.STOPPED])
def test_silence_is_reported_after_50_ms_and_ended_after_half_a_second(
    activity: Activity,
) -> None:
    found = looks(watch_of(activity), [1, 2, 3] + [3] * 40)
    began, killed = found.index(Silence.BEGAN), found.index(Silence.KILL)
    assert set(found[:began]) == {Silence.TICKS}
    assert 0.05 < LOOK_S * (began - 2) <= 0.08
    assert 0.5 < LOOK_S * (killed - 2) <= 0.54


def test_a_process_that_ticks_again_is_reported_and_begins_anew() -> None:
    watch = watch_of()
    found = looks(watch, [1] + [1] * 20 + [2, 3] + [3] * 20)
    assert [each for each in found if each in (Silence.BEGAN, Silence.OVER)] == [
        Silence.BEGAN, Silence.OVER, Silence.BEGAN,
    ]  # fmt: skip
    assert Silence.KILL not in found


def test_slow_but_complete_ticks_are_never_killed() -> None:
    """A tick each 300 ms at 200 Hz."""
    found = looks(watch_of(), [number // 15 for number in range(15, 600)])
    assert Silence.BEGAN in found
    assert Silence.KILL not in found


def test_a_slow_rate_has_longer_bounds() -> None:
    found = looks(watch_of(rate_hz=5.0), [number // 10 for number in range(10, 100)])
    assert set(found) == {Silence.TICKS}


def test_nothing_counts_before_the_first_tick() -> None:
    assert set(looks(watch_of(Activity.STOPPED), [0] * 500)) == {Silence.TICKS}


def test_a_request_to_devices_may_take_long_but_not_a_signal() -> None:
    assert set(looks(watch_of(), [1] * 500, preparing=True)) == {Silence.TICKS}
    assert Silence.KILL in looks(watch_of(Activity.STOPPED), [1] * 500, preparing=True)


def test_time_without_a_processor_does_not_count() -> None:
    assert set(looks(watch_of(Activity.WAITS), [1] * 500)) == {Silence.TICKS}
    # The daemon itself has not run: ten looks in five seconds.
    assert Silence.KILL not in looks(watch_of(), [1] * 10, every_s=0.5)


@pytest.mark.process
@pytest.mark.realtime
def test_the_kernel_names_what_a_process_does() -> None:
    spin = "print(flush=True)\nwhile True: pass"
    sleep = "print(flush=True)\nimport time; time.sleep(60)"
    for program, expected in ((spin, Activity.GOES_ON), (sleep, Activity.GOES_ON)):
        with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            process.stdout.readline()
            activity = ProcessActivity(process.pid)

            def found(activity: ProcessActivity = activity) -> Activity:
                activity()
                time.sleep(0.1)
                return activity()

            until(lambda expected=expected: found() is expected, "it goes on")  # type: ignore[misc]
            process.send_signal(signal.SIGSTOP)
            until(lambda: found() is Activity.STOPPED, "it is stopped")
            process.kill()
    assert ProcessActivity(process.pid)() is Activity.GOES_ON  # there is none


def test_a_thread_that_could_run_and_does_not_waits(tmp_path: Path) -> None:
    thread = tmp_path / "7" / "task" / "7"
    thread.mkdir(parents=True)
    activity = ProcessActivity(7, tmp_path)

    def found(state: str, ran_ns: int) -> Activity:
        (thread / "stat").write_text(f"7 (a) b) {state} 1 2 3")
        (thread / "schedstat").write_text(f"{ran_ns} 8 9")
        return activity()

    assert found("R", 10) is Activity.GOES_ON
    assert found("R", 20) is Activity.GOES_ON
    assert found("R", 20) is Activity.WAITS
    assert found("S", 20) is Activity.GOES_ON
    assert found("t", 20) is Activity.WAITS
    assert found("T", 20) is Activity.STOPPED


@pytest.mark.process
@pytest.mark.realtime
@pytest.mark.parametrize("state", ["OFF", "HOLD", "APPROACH"])
def test_a_stall_in_any_state_ends_the_run_with_words(state: str) -> None:
    with daemon() as running, running.client() as client, running.client() as other:
        armed(client)
        if state == "OFF":
            client.estop()
        if state == "APPROACH":
            client.move(HERE, wait=False)
        until(lambda: states(client) == {state}, "it is in that state")
        stop = time.monotonic()
        os.kill(control_of(running), signal.SIGSTOP)
        until(lambda: other.status()["stalled"], "status has it")
        reported_s = time.monotonic() - stop
        running.process.wait(30)
        ended_s = time.monotonic() - stop
        code, ending, messages = ended(running)
        assert code == 3
        assert "stood still for 0.5 s and was killed" in ending or "fault" in ending
        assert "warning: the control process stands still" in messages
        assert reported_s < 0.5 < ended_s


#: Runs in the control process only: the model of the second robot is one in C that does not return.
C_MODEL = """\
import sys
if "contid.control.process" in sys.orig_argv:
    import contid.control.engine.engine as engine
    tick, calls = engine.tick, 0
    def slow(config, *rest, **keys):
        global calls
        calls += config.name == "f1"
        if calls == 300:
            sum(range(10**11))  # in C, and no signal interrupts it as it would a sleep
        return tick(config, *rest, **keys)
    engine.tick = slow
"""


@pytest.mark.process
@pytest.mark.realtime
def test_a_model_in_c_that_does_not_return_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    at_start(monkeypatch, tmp_path, C_MODEL)
    with daemon(3) as running:
        running.process.wait(120)  # the time without a processor does not count
        code, ending, messages = ended(running)
    assert code == 3
    assert "stood still for 0.5 s in the model of f1 and was killed" in ending
    assert "warning: the control process stands still in the model of f1" in messages


@pytest.mark.process
@pytest.mark.realtime
@pytest.mark.parametrize(
    ("does", "killed"),
    [
        # A library that keeps the lock of the interpreter: no thread of Python runs.
        ("import ctypes; ctypes.PyDLL(None).sleep(30)", True),
        ("import time; time.sleep(30)", True),
        ("import time; time.sleep(0.25)", False),
    ],
)
def test_a_driver_that_hangs_ends_the_run_and_a_slow_one_does_not(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, does: str, killed: bool
) -> None:
    at_start(monkeypatch, tmp_path, LIBRARY.format(does=does))
    with daemon() as running:
        if killed:
            running.process.wait(30)
            code, _, messages = ended(running)
            assert code == 3
            assert "stands still; it is killed" in messages
        else:
            with running.client() as client:
                until(lambda: (client.status()["tick"] or 0) > 180, "it ticks")
                assert not client.status()["stalled"]
            assert "it is killed" not in running.end()
