"""A model that fails where a stage asks it costs its own robot only, and a replay asks it as little."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from contid.control.engine.messages import Goto, Message, Resume
from contid.control.engine.tick_costs import TickCosts, UnansweredError
from contid.control.engine.virtual import VirtualProcess
from contid.control.engine.watch.tip_watch import TipWatch
from contid.control.tick.faults import Fault
from contid.control.tick.supervisor import Mode
from contid.errors import ContidError
from contid.robot_file.load import LoadedFile, parse_robot_file
from contid.targets import Target
from contid.trajectory.read import read_trajectory
from contid_clearance.watch import ClearanceWatch
from contid_contact.current_contact import AxisContactFound, CurrentContact
from contid_contact.stage import ContactStage
from tests.support.broken.broken_run import BadModel
from tests.support.fingers import Collector, circle_csv, fingers

BROKEN_FROM, TICKS = 150, 270
Deed = Callable[[TickCosts], Callable[..., Any]]

CLEARANCE = """\
clearance:
  margin_mm: 1
  bodies: {f0: {radius_mm: 7}, f1: {radius_mm: 7}, f2: {radius_mm: 7}}
  ignore: [[f0, f2]]
"""


def unanswered(costs: TickCosts) -> Callable[..., Any]:
    """As the port of a model in a process of its own, when there is no answer in time."""

    def answer(*_: object) -> Any:
        if costs.running >= 0:
            costs.running = -1
            raise UnansweredError("its model did not answer")
        raise ContidError("its model did not answer")

    return answer


def raises(costs: TickCosts) -> Callable[..., Any]:
    def answer(*_: object) -> Any:
        raise RuntimeError("no idea")

    return answer


class StagedRun:
    """Fingers on a circle, of which the second one's model fails in the stages from a tick on."""

    def __init__(self, loaded: LoadedFile) -> None:
        self.collector = Collector(loaded)
        text = circle_csv(len(loaded.driven), period_s=5.0)
        if "clearance" in loaded.text:  # quick enough that bodies are computed again and again
            text = apart(circle_csv(len(loaded.driven), period_s=2.5))
        trajectory = read_trajectory(io.StringIO(text), "circle.csv", loaded.driven)
        self.process = VirtualProcess(loaded, 200.0, self.collector, trajectory=trajectory, attended=True)
        self.engine = self.process.engine
        self.bad: list[BadModel] = []

    def break_model(self, deed: Deed, *methods: str) -> None:
        """Let methods of the model of the second robot fail wherever it is asked."""
        answers = dict.fromkeys(methods, deed(self.engine.costs))
        robots = self.engine.robots
        configs = list(robots.configs)
        self.bad.append(BadModel(configs[1].model, **answers))
        configs[1] = replace(configs[1], model=self.bad[-1])
        robots.configs = tuple(configs)
        for stage in self.engine._after:
            if isinstance(stage, TipWatch):
                stage._tips[1].config = configs[1]
            if isinstance(stage, ClearanceWatch):
                arm = stage._guard.arms["f1"]
                self.bad.append(BadModel(arm.model, **answers))
                stage._guard.arms["f1"] = replace(arm, model=self.bad[-1])

    def go(
        self,
        known: list[dict[str, Any]] | None = None,
        order: Message | None = None,
        at: int = BROKEN_FROM,
        heals: int = TICKS,
    ) -> list[Any]:
        """The records of a run, with an order in the tick of the defect, or of a replay with its events."""
        self.engine.arm()
        while self.process.tick < TICKS:
            self.process.begin()
            for bad in self.bad:
                bad.broken = BROKEN_FROM <= self.process.tick < heals
            for event in known or ():
                if event["event"] == "overran" and event["tick"] == self.process.tick:
                    error = UnansweredError(event["message"], Fault(event["fault"]))
                    self.engine.robots.overran[event["robot"], event["question"]] = error
            if order is not None and self.process.tick == at:
                self.engine.obey(order, at)
            self.process.turn()
        self.process.close()
        return self.collector.records

    def faults(self) -> list[tuple[str, str]]:
        return [(e["robot"], e["name"]) for e in self.collector.events if e["event"] == "fault"]

    def refused(self) -> list[str]:
        return [e["message"] for e in self.collector.events if e["event"] == "refused"]


def of(records: list[Any], robot: int) -> list[str]:
    return [repr((record.tick, record.robots[robot])) for record in records]


def apart(circle: str) -> str:
    """The circles of fingers whose bases are 200 mm apart."""
    head, *rows = circle.splitlines()
    out = [head]
    for row in rows:
        time, *values = row.split(",")
        moved = [repr(float(each) + (100 * i if i % 2 == 0 else 0)) for i, each in enumerate(values)]
        out.append(",".join([time, *moved]))
    return "\n".join(out) + "\n"


def loaded_with(keys: str) -> LoadedFile:
    text = fingers(2, buses=2).replace("    axes:", f"    {keys}\n    axes:")
    return parse_robot_file(text, "fingers.yaml")


def test_a_question_of_an_order_that_is_not_answered_replays() -> None:
    loaded = loaded_with("sense: {usual_ma: 100, contact_ma: 50, contact: hold, nm_per_a: 0.5}")
    goto = Goto("f1", Target(tip_m=(0.052, 0.078, 0.0)), until_force_n=0.5)
    run = StagedRun(loaded)
    run.break_model(unanswered, "inverse", "forward")
    records = run.go(order=goto)
    assert run.faults() == [("f1", "MODEL_TOO_SLOW")]
    again = StagedRun(loaded)
    assert repr(again.go(run.collector.events, goto)) == repr(records)
    assert again.faults() == run.faults()


@pytest.fixture
def touched(monkeypatch: pytest.MonkeyPatch) -> LoadedFile:
    """Fingers that look for contacts; each finds one in the tick in which the model is broken."""
    touches: dict[Any, int] = {}

    def find(currents: Any, samples: Any) -> AxisContactFound | None:
        return AxisContactFound((0,), 0.1, 1.0) if touches.pop(currents, 0) == BROKEN_FROM else None

    monkeypatch.setattr(CurrentContact, "tick", find)
    before = ContactStage.before

    def count(stage: ContactStage, targets: Any, timing: Any, now_s: float) -> Any:
        touches.update(dict.fromkeys(stage._currents.values(), timing.tick))
        return before(stage, targets, timing, now_s)

    monkeypatch.setattr(ContactStage, "before", count)
    return loaded_with("sense: {usual_ma: 100, contact_ma: 50, contact: hold}")


@pytest.mark.parametrize(
    ("deed", "fault"), [(unanswered, "MODEL_TOO_SLOW"), (raises, "INTERNAL")], ids=["late", "raises"]
)
def test_a_model_that_fails_at_a_contact_costs_its_robot_only(
    touched: LoadedFile, deed: Deed, fault: str
) -> None:
    sound = StagedRun(touched)
    sound.go()
    run = StagedRun(touched)
    run.break_model(deed, "forward")
    records = run.go()
    assert run.faults() == [("f1", fault)]
    assert of(records, 0) == of(sound.collector.records, 0)
    assert records[-1].robots[0].mode is Mode.HOLD
    if deed is unanswered:
        again = StagedRun(touched)
        assert repr(again.go(run.collector.events)) == repr(records)


def test_a_model_that_is_late_where_its_tip_is_watched_is_a_fault_and_replays() -> None:
    """The watch took no answer for no deviation, which the replay then found."""
    loaded = loaded_with("follow_tip_mm: 5")
    run = StagedRun(loaded)
    run.break_model(unanswered, "forward")
    records = run.go()
    assert run.faults() == [("f1", "MODEL_TOO_SLOW")]
    (event,) = [event for event in run.collector.events if event["event"] == "overran"]
    assert (event["tick"], event["question"]) == (BROKEN_FROM, 0)
    assert {record.robots[0].mode for record in records[BROKEN_FROM:]} == {Mode.RUN}
    again = StagedRun(loaded)
    assert repr(again.go(run.collector.events)) == repr(records)


def kept_apart() -> LoadedFile:
    bases = iter((0, 200, 400))
    text = re.sub(r"base: .*", lambda _: f"base: {{x_mm: {next(bases)}}}", fingers(3, buses=2))
    return parse_robot_file(text + CLEARANCE, "fingers.yaml")


@pytest.mark.parametrize("heals", [True, False])
def test_the_others_move_again_when_the_body_is_known(heals: bool) -> None:
    run = StagedRun(kept_apart())
    run.break_model(unanswered, "shape")
    records = run.go(order=Resume(("f0",)), at=220, heals=210 if heals else TICKS)
    assert (records[-1].robots[0].mode is Mode.HOLD) is not heals
    assert len(run.refused()) == (2 if heals else 3)
    assert run.faults() == [("f1", "MODEL_TOO_SLOW")]


@pytest.mark.parametrize(
    ("deed", "fault"), [(unanswered, "MODEL_TOO_SLOW"), (raises, "INTERNAL")], ids=["late", "raises"]
)
def test_a_body_that_cannot_be_computed_is_a_fault_of_its_robot_and_the_others_hold(
    deed: Deed, fault: str
) -> None:
    """Where a body is that stops is unknown: no other may move, and none has a fault."""
    loaded = kept_apart()
    run = StagedRun(loaded)
    run.break_model(deed, "shape")
    records = run.go()
    assert run.faults() == [("f1", fault)]
    assert [record.robots[0].mode for record in records[-1:]] == [Mode.HOLD]
    assert [record.robots[2].mode for record in records[-1:]] == [Mode.HOLD]
    refused = run.refused()
    assert len(refused) == 2, refused
    assert all("the body of f1 cannot be computed" in message for message in refused)
    # They brake within their limits.
    for robot in (0, 2):
        limits = run.engine.robots.configs[robot].limits
        for axis, limit in enumerate(limits):
            commands = [record.robots[robot].axes[axis].command for record in records[BROKEN_FROM - 5 :]]
            steps = [b - a for a, b in pairwise(commands)]
            assert max(abs(b - a) for a, b in pairwise(steps)) <= limit.change * 1.0001
            assert steps[-1] == 0.0
    if deed is unanswered:
        again = StagedRun(loaded)
        assert repr(again.go(run.collector.events)) == repr(records)
