"""SIGTERM in every state, in real time: every process gone within 2 s, and nothing left behind.

``python -m tests.campaign.exits [--rounds N] [--seed N]`` prints how long each state took. The instant within
a state is drawn at random. A stop that moves (``on_interrupt: rest``) may take as long as its motion on top.
"""

from __future__ import annotations

import argparse
import random
import subprocess
import sys
from collections.abc import Callable

from contid.client import Client
from tests.campaign.ended_daemons import EndedDaemons
from tests.support.fingers import fingers
from tests.support.waiting import until

AWAY = {"x_mm": 35.0, "y_mm": 80.0}


class Exits(EndedDaemons):
    """States by name are its methods."""

    def importing(self) -> None:
        self._start(fingers(1))
        self._wait(0.0, 0.7)

    def waiting_for_stdin(self) -> None:
        self._start(fingers(1), stdin=subprocess.PIPE)
        self._wait(0.5, 1.5)

    def waiting_for_rows(self) -> None:
        self._start(fingers(1), stdin=subprocess.PIPE)
        assert self.process.stdin is not None
        self.process.stdin.write(b"x_mm,y_mm\n")
        self.process.stdin.flush()
        self._client()
        self._wait(0.0, 0.3)

    def servos_that_do_not_answer(self) -> None:
        self._dead("hand")

    def board_that_does_not_answer(self) -> None:
        self._dead("trirack")

    def connecting(self) -> None:
        silent = "".join(f"- {{at_s: 0.001, kind: silent, axis: f0.{side}}}\n" for side in ("left", "right"))
        self._start(fingers(1, options=f"faults:\n{_indented(silent)}"))
        self._client()
        self._wait(0.0, 1.0)

    def disarmed(self) -> None:
        self._start(fingers(2), "--disarmed")
        self._client()
        self._until("READY")

    def approach(self) -> None:
        self._start(fingers(1))
        self._client()
        self._until("HOLD")
        self.client.move(AWAY, wait=False)
        self._wait(0.0, 0.15)

    def run(self) -> None:
        self._start(fingers(1))
        self._client()
        self._until("HOLD")
        self.client.move({"x_mm": 50.0, "y_mm": 75.0})
        begun = self.client.request("move", columns=["x_mm", "y_mm"])
        self.client.request("rows", move=begun["move"], rows=[[50.0, 75.0]])
        self._until("RUN")

    def hold(self) -> None:
        self._start(fingers(2, buses=2))
        self._client()
        self._until("HOLD")
        self._wait(0.0, 0.1)

    def stopping(self) -> None:
        self._start(fingers(1, on_interrupt="rest"))
        self._client()
        self._until("HOLD")
        self.client.move(AWAY)
        self.client.stop()
        self._wait(0.0, 0.2)

    def fault(self) -> None:
        self._start(fingers(1, options="faults:\n  - {at_s: 0.5, kind: overload, axis: f0.left}\n"))
        self._client()
        self._until("FAULT")
        self._wait(0.0, 0.3)

    def bus_gone(self) -> None:
        self._start(fingers(2, buses=2, options="faults:\n  - {at_s: 0.5, kind: lost}\n"))
        self._client()
        until(lambda: "FAULT" in self._states(), "the bus is gone")
        self._wait(0.0, 1.5)

    def bus_hangs(self) -> None:
        """The exchange of the only bus does not come back."""
        self._start(fingers(1, options="faults:\n  - {at_s: 0.6, kind: late, delay_ms: 600000}\n"))
        self._client()
        until(lambda: self.client.status().get("tick_age_ms", 0.0) > 100.0, "it hangs")

    def with_clients(self) -> None:
        """One streams, one listens and does not read."""
        self.run()
        for _ in range(3):
            other = self._stack.enter_context(Client(self.socket))
            other.request("subscribe", rate_hz=200.0, events=True)
        self._wait(0.1, 0.5)

    def recording(self) -> None:
        self._start(fingers(1), "--record", "s.mcap")
        self._client()
        self._until("HOLD")
        self._wait(0.2, 0.6)


def _indented(lines: str) -> str:
    return "".join(f"  {line}\n" for line in lines.splitlines())


STATES: tuple[Callable[[Exits], None], ...] = (
    *(Exits.importing, Exits.waiting_for_stdin, Exits.waiting_for_rows, Exits.servos_that_do_not_answer),
    *(Exits.board_that_does_not_answer, Exits.connecting, Exits.disarmed, Exits.approach, Exits.run),
    *(
        Exits.hold,
        Exits.stopping,
        Exits.fault,
        Exits.bus_gone,
        Exits.bus_hangs,
        Exits.with_clients,
        Exits.recording,
    ),
)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign.exits", description="SIGTERM everywhere.")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    exits, wrong = Exits(random.Random(asked.seed)), []
    print(f"{'state':<32}{'cases':>8}{'median s':>10}{'worst s':>10}{'violations':>12}")
    for state in STATES:
        left = [exits.leave(state) for _ in range(asked.rounds)]
        seconds = sorted(each.seconds for each in left)
        found = [message for each in left for message in each.violations()]
        wrong += found
        times = f"{seconds[len(seconds) // 2]:>10.2f}{seconds[-1]:>10.2f}"
        print(f"{left[0].state:<32}{len(left):>8}{times}{len(found):>12}", flush=True)
    print("\n".join(wrong))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
