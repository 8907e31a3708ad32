"""A wrong answer or an error of one robot's driver costs that robot only, reported by its own message."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import pytest

from contid.control.engine.cycle import VirtualClock
from contid.control.engine.ports import BusTrackers
from contid.control.engine.wiring import open_buses
from contid.control.tick.supervisor import Mode
from contid.errors import ContidError
from contid.hal import Sample
from tests.support.broken.broken_run import BROKEN_FROM, BrokenRun, fail, good_of, leave, unharmed
from tests.support.fingers import load


@pytest.fixture(scope="module")
def sound() -> list[str]:
    return good_of(BrokenRun())


SAMPLES: dict[str, tuple[Callable[[Any], Any], str]] = {
    "text": (lambda samples: "fine", "fine"),
    "None": (lambda samples: None, "None"),
    "a number": (lambda samples: 3, "3"),
    "a list": (lambda samples: list(samples.values()), "list"),
    "text as a sample": (lambda samples: dict.fromkeys(samples, "here"), "here"),
    "None as a sample": (lambda samples: dict.fromkeys(samples), "None"),
    "one text as a sample": (lambda samples: {**samples, "f1.left": "here"}, "here"),
    "text as a value": (lambda samples: each(samples, value="far"), "far"),
    "text as an effort": (lambda samples: each(samples, effort="much"), "much"),
    "None as a time": (lambda samples: each(samples, time_s=None), "None"),
    "text as an age": (lambda samples: each(samples, age_s="old"), "old"),
    "None as validity": (lambda samples: each(samples, valid=None), "None"),
    "a number as a fault": (lambda samples: each(samples, fault=7), "7"),
    "it raises": (fail, "no idea"),
    "it exits": (leave, "enough"),
}


def each(samples: Mapping[str, Sample], **fields: Any) -> dict[str, Sample]:
    return {axis: replace(sample, **fields) for axis, sample in samples.items()}


#: Each is found where another one is that CI tries.
ALIKE = ("None", "a number", "None as a sample", "text as an effort", "text as an age")


@pytest.mark.parametrize(
    "kind",
    [pytest.param(kind, marks=pytest.mark.campaign if kind in ALIKE else ()) for kind in SAMPLES],
)
def test_what_a_driver_answers_costs_its_robot_only(sound: list[str], kind: str) -> None:
    run = BrokenRun()
    change, words = SAMPLES[kind]
    run.break_bus(change)
    records = run.go()
    assert unharmed(records, sound)
    assert words in run.fault()[1]
    assert {record.robots[1].mode for record in records[BROKEN_FROM + 1 :]} == {Mode.FAULT}


def test_samples_of_axes_of_another_bus_are_not_taken(sound: list[str]) -> None:
    run = BrokenRun()
    wrong = Sample(0.0, 0.0, valid=True, age_s=9.0, fault="not mine")
    run.break_bus(lambda samples: {**samples, "f0.left": wrong})
    assert unharmed(run.go(), sound)
    assert not [event for event in run.collector.events if event["event"] == "fault"]


class NoDriver:
    """A driver that cannot make a bus, or open it, or close it."""

    name, axes = "bus0", ("f0.left", "f0.right")

    def __init__(self, opens: bool) -> None:
        self._opens = opens

    def open_bus(self, *_: object) -> NoDriver:
        if self._opens:
            return self
        raise ValueError("baud rate of tea")

    def open(self) -> None:
        raise KeyError("no such port")

    def close(self) -> None:
        raise RuntimeError("it never was open")


@pytest.mark.parametrize(
    ("opens", "words"), [(False, "ValueError: baud rate of tea"), (True, "no such port")]
)
def test_a_driver_that_fails_to_open_is_reported(
    monkeypatch: pytest.MonkeyPatch, opens: bool, words: str
) -> None:
    monkeypatch.setattr("contid.control.engine.wiring.load_driver", lambda name: NoDriver(opens))
    with pytest.raises(ContidError, match=f"bus bus0: driver 'sim': .*{words}"):
        open_buses(load(1), VirtualClock())


def test_a_tracker_that_fails_is_reported_and_not_read_any_more(caplog: pytest.LogCaptureFixture) -> None:
    class Tracker(NoDriver):
        def measured_tips(self) -> Any:
            raise OSError("no camera")

    trackers = BusTrackers([Tracker(True)])  # type: ignore[list-item]
    for _ in range(3):
        assert not [*trackers.arrived(0.0)]
    assert caplog.text.count("no camera") == 1
