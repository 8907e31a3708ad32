"""Orders and answers survive the way into an event and back, exactly."""

from __future__ import annotations

import json

import pytest

from contid.control.engine import messages as msg
from contid.control.engine.events.buses import BusAnswered
from contid.control.engine.events.json_form import from_json, to_json
from contid.control.engine.events.robots import OrderGiven
from contid.control.engine.order_events import answer_event, order_event
from contid.control.engine.ports import BusReply
from contid.control.tick.state import Effect
from contid.errors import ContidError
from contid.robot_file.base import StopPolicy
from contid.targets import Target
from contid_sessions.replay.recorded_orders import answer_of, order_of

TARGET = Target(
    tip_m=(0.1, 1 / 3, -0.0), direction=(0.0, 0.0, 1.0), mid_m=(1e-300, 0.2, 0.3), load_n=(0.0, 0.0, -0.1),
    extra={"wrist": 0.07}, measured_tip_m=(0.1, 0.3, 0.0), measured_direction=(0.6, 0.8, 0.0),
)  # fmt: skip


@pytest.mark.parametrize(
    "message",
    [
        msg.Hold(), msg.Hold(("thumb",)), msg.Resume(), msg.Follow(("a",)), msg.Estop(("a", "b")),
        msg.ClearFault(), msg.Stop(("thumb",), StopPolicy.REST, "on_end"), msg.Stop(), msg.Finish(),
        msg.EndOfRows(), msg.Finish(StopPolicy.RELAX, "on_host_loss"), msg.Goto("thumb", TARGET),
        msg.Goto("thumb", Target(actuation=(0.07, 0.03))), msg.Rows({"thumb": TARGET}),
        msg.Rows({"thumb": None}), msg.Rows({}), msg.Rows({"a": TARGET, "b": None}),
        msg.Measured("thumb", (0.1, 1 / 3, 0.0)), msg.Grip(0.3), msg.Grip(1 / 3, ("thumb",)),
        msg.Measured("thumb", (0.1, 0.2, 0.0), (0.6, 0.8, 0.0), 1 / 300),
    ],
    ids=repr,
)  # fmt: skip
def test_an_order_comes_back(message: msg.Message) -> None:
    event = order_event(message, 5)
    assert event is not None
    read = from_json(json.loads(json.dumps(to_json(event))))
    assert isinstance(read, OrderGiven)
    assert read.tick == 5
    assert order_of(read) == message


def test_a_row_of_an_early_recording_is_one_event_per_robot() -> None:
    event = order_event(msg.Goto("thumb", TARGET), 5)
    assert event is not None
    order = {"order": "rows", "robot": "thumb", "target": event.order["target"]}
    assert order_of(OrderGiven(tick=5, order=order)) == msg.Rows({"thumb": TARGET})


def test_a_measurement_of_an_early_recording_has_neither_direction_nor_age() -> None:
    order = {"order": "measured", "robot": "thumb", "tip_m": [0.1, 0.2, 0.0]}
    assert order_of(OrderGiven(tick=3, order=order)) == msg.Measured("thumb", (0.1, 0.2, 0.0), None, 0.0)


def test_an_unknown_order_is_refused() -> None:
    with pytest.raises(ContidError, match="tick 7: the order 'play'"):
        order_of(OrderGiven(tick=7, order={"order": "play"}))


def test_an_answer_comes_back() -> None:
    answer = BusReply(None, "gone", [(0, Effect.ENABLE)], [(1, Effect.CLEAR, "still hot")])
    event = from_json(json.loads(json.dumps(to_json(answer_event(answer, "bus0", 3)))))
    assert isinstance(event, BusAnswered)
    assert answer_of(event) == answer
