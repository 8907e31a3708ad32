"""A client's side of the protocol by itself: what it makes of a daemon's words, in their order."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid.remote.client.client_protocol import ClientProtocol, Request
from contid.remote.client.procedures import Ask, Listen, RowSender, Step, arrival
from contid.remote.protocol.wire import Code, Fields, RemoteError, encode


def answer(request: Request, **result: Any) -> bytes:
    return encode({"id": request.number, "ok": True, "result": result})


def credit(move: int, credits: int) -> bytes:
    return encode({"event": "credit", "move": move, "credits": credits})


@given(st.lists(st.integers(1, 40), max_size=8))
def test_words_mean_the_same_wherever_they_are_cut(cuts: list[int]) -> None:
    dialogue = ClientProtocol()
    asked = dialogue.ask("status", {})
    said = credit(3, 5) + answer(asked, tick=7) + encode({"event": "telemetry", "tick": 8})
    for cut in cuts:
        dialogue.receive(said[:cut])
        said = said[cut:]
    dialogue.receive(said)
    assert dialogue.result(asked) == {"tick": 7}
    assert list(dialogue.new_frames()) == [{"event": "telemetry", "tick": 8}]
    assert dialogue.credits == {3: 5}


def test_an_answer_for_which_nobody_waits_any_more_is_dropped() -> None:
    dialogue = ClientProtocol()
    late, asked = dialogue.ask("status", {}), dialogue.ask("ping", {})
    dialogue.forget(late)
    dialogue.receive(answer(late, tick=1))
    assert dialogue.result(late) is None
    dialogue.receive(encode({"id": None, "ok": False, "error": {"code": "bad-request", "message": "what?"}}))
    with pytest.raises(RemoteError, match="what") as refused:
        dialogue.result(asked)
    assert refused.value.code == Code.BAD_REQUEST


def test_another_protocol_is_refused_at_its_hello() -> None:
    with pytest.raises(RemoteError, match="protocol 99"):
        ClientProtocol().receive(encode({"event": "hello", "protocol": 99}))


def test_credit_is_what_the_newest_line_says() -> None:
    """A notice that came before the answer to further rows is spent by them."""
    dialogue = ClientProtocol()
    begun = dialogue.ask("move", {"columns": ["x_mm"]})
    dialogue.receive(answer(begun, move=4, timed=False, credits=8))
    assert dialogue.credits[4] == 8
    sent = dialogue.ask("rows", {"move": 4, "rows": [[1.0]]})
    dialogue.receive(credit(4, 4) + answer(sent, credits=0, refused=[]))
    assert dialogue.credits[4] == 0
    dialogue.receive(credit(4, 4))
    assert dialogue.credits[4] == 4


class Daemon:
    """Carries out the steps of a procedure: grants ``credits`` rows, then so many at every notice."""

    def __init__(self, dialogue: ClientProtocol, timed: bool, credits: int) -> None:
        self.dialogue, self.timed, self.credits = dialogue, timed, credits
        self.batches: list[int] = []
        self.notices = 0
        self.ended = False

    def follow(self, procedure: Any) -> Any:
        result: Fields = {}
        try:
            step: Step = next(procedure)
            while True:
                if isinstance(step, Ask):
                    asked = self.dialogue.ask(step.verb, step.fields)
                    self.dialogue.receive(answer(asked, **self.result(step)))
                    result = self.dialogue.result(asked) or {}
                elif isinstance(step, Listen):
                    self.notices += 1
                    self.dialogue.receive(credit(1, self.credits))
                step = procedure.send(result)
        except StopIteration as stop:
            return stop.value

    def result(self, step: Ask) -> Fields:
        match step.verb:
            case "move":
                return {"move": 1, "timed": self.timed, "credits": self.credits}
            case "rows":
                self.batches.append(len(step.fields["rows"]))
                assert self.batches[-1] <= self.dialogue.credits[1], "never more than was granted"
                left = self.credits if self.timed else self.dialogue.credits[1] - self.batches[-1]
                return {"credits": left, "refused": []}
            case "end":
                self.dialogue.receive(encode({"event": "move", "move": 1, "reached": True, "message": ""}))
                self.ended = True
        return {}


@pytest.mark.parametrize(("timed", "credits", "notices"), [(False, 8, 12), (False, 1, 99), (True, 1024, 0)])
def test_rows_are_sent_under_credit(timed: bool, credits: int, notices: int) -> None:
    dialogue = ClientProtocol()
    daemon = Daemon(dialogue, timed, credits)
    sender = RowSender(dialogue, ["x_mm"])
    daemon.follow(sender.begin())
    for number in range(100):
        daemon.follow(sender.add((number,)))
    daemon.follow(sender.end(wait=True))
    assert sum(daemon.batches) == 100
    assert daemon.batches == ([100] if timed else [1] * 100)
    assert daemon.notices == notices
    assert daemon.ended


def test_a_move_that_is_stopped_says_so_to_whoever_waits() -> None:
    dialogue = ClientProtocol()
    dialogue.receive(encode({"event": "move", "move": 2, "reached": False, "message": "somebody held"}))
    with pytest.raises(RemoteError, match="somebody held") as refused:
        next(arrival(dialogue, 2))
    assert refused.value.code == Code.STOPPED
