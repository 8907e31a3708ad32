"""Messages between the control process and a kept process; those of a bus: fixed structs for every tick.

The messages of a model are in `contid.control.process.isolation.model_wire`.

    request  kind, number | of a job, per axis: has a command; command | JSON, if any
    answer   kind, number | of a job, per axis: parts that are there; their values | JSON, if any

Faults, effects and errors are rare and go into the JSON. An answer has the number of its request.
"""

from __future__ import annotations

import enum
import json
from collections.abc import Mapping, Sequence
from struct import Struct
from typing import Any, Final, NamedTuple

from contid.control.engine.ports import BusJob, BusReply
from contid.control.tick.state import Effect
from contid.hal import REPORTED, Sample

#: `RequestKind` and number, at the head of every message.
HEAD: Final = Struct("=BI")
#: Longest message; a text is cut to `LONGEST_TEXT` characters.
LONGEST: Final = 1 << 17
LONGEST_TEXT: Final = 1000

#: Parts of a sample, in the order of their values; ``value`` and those after ``age_s`` may be absent.
_NUMBERS: Final = ("time_s", "age_s", "value", *REPORTED)
_PRESENT, _VALID = 1 << len(_NUMBERS), 2 << len(_NUMBERS)
_SAMPLE: Final = Struct(f"=H{len(_NUMBERS)}d")


class RequestKind(enum.IntEnum):
    """What a request asks for, and its answer answers; to a job whose bus cannot be built it is `OPEN`."""

    JOB = 1
    OPEN = 2
    COUNTS = 3
    EFFORT = 4
    CLOSE = 5
    ASK = 6
    HURRY = 7


class KeptAnswer(NamedTuple):
    """An answer without its number."""

    kind: RequestKind
    body: bytes


class BusWire:
    """The bodies of jobs and their replies, for a bus with given axes."""

    def __init__(self, axes: Sequence[str]) -> None:
        self.axes = tuple(axes)
        self._commands = Struct(f"={len(self.axes)}?{len(self.axes)}d")

    # -- requests ----------------------------------------------------------------------------------------

    def job(self, job: BusJob) -> bytes:
        """The request of a job."""
        commands = job.commands
        there = [axis in commands for axis in self.axes]
        values = [commands.get(axis, 0.0) for axis in self.axes]
        extra = b""
        if job.reopen or job.effects:
            effects = [[robot, effect.name, axes] for robot, effect, axes in job.effects]
            extra = json.dumps({"reopen": job.reopen, "effects": effects}).encode()
        return self._commands.pack(*there, *values) + extra

    def job_of(self, body: bytes) -> BusJob:
        """The job of a request."""
        count = len(self.axes)
        numbers = self._commands.unpack_from(body)
        there, values = numbers[:count], numbers[count:]
        given = zip(self.axes, there, values, strict=True)
        commands = {axis: value for axis, has, value in given if has}
        if len(body) == self._commands.size:
            return BusJob(commands)
        extra = json.loads(body[self._commands.size :])
        effects = tuple((robot, Effect[name], tuple(axes)) for robot, name, axes in extra["effects"])
        return BusJob(commands, effects, extra["reopen"])

    # -- replies -----------------------------------------------------------------------------------------

    def reply(self, reply: BusReply, extra: Mapping[str, Any]) -> bytes:
        """The result of a job, and what else the bus has to report."""
        samples = reply.samples or {}
        parts, faults = [], {}
        for axis in self.axes:
            sample = samples.get(axis)
            if sample is None:
                parts.append(_SAMPLE.pack(0, *[0.0] * len(_NUMBERS)))
                continue
            numbers = [getattr(sample, name) for name in _NUMBERS]
            has = sum(1 << bit for bit, each in enumerate(numbers) if each is not None)
            bits = has | _PRESENT | (_VALID if sample.valid else 0)
            parts.append(_SAMPLE.pack(bits, *[0.0 if each is None else each for each in numbers]))
            if sample.fault:
                faults[axis] = sample.fault[:LONGEST_TEXT]
        rest: dict[str, Any] = dict(extra)
        if faults:
            rest["faults"] = faults
        if reply.lost or reply.samples is None:
            rest["lost"] = reply.lost[:LONGEST_TEXT] or "no samples"
        if reply.done:
            rest["done"] = [[robot, effect.name] for robot, effect in reply.done]
        if reply.refused:
            rest["refused"] = [
                [robot, effect.name, text[:LONGEST_TEXT]] for robot, effect, text in reply.refused
            ]
        return b"".join(parts) + (json.dumps(rest).encode() if rest else b"")

    def reply_of(self, body: bytes) -> tuple[BusReply, Mapping[str, Any]]:
        """The result of a job from a reply, and its JSON."""
        end = len(self.axes) * _SAMPLE.size
        rest: Mapping[str, Any] = json.loads(body[end:]) if len(body) > end else {}
        answer = BusReply(
            None,
            rest.get("lost", ""),
            [(robot, Effect[name]) for robot, name in rest.get("done", ())],
            [(robot, Effect[name], text) for robot, name, text in rest.get("refused", ())],
        )
        if not answer.lost:
            faults: Mapping[str, str] = rest.get("faults", {})
            answer.samples = {
                axis: _sample(bits, numbers, faults.get(axis, ""))
                for axis, (bits, *numbers) in zip(
                    self.axes, _SAMPLE.iter_unpack(memoryview(body)[:end]), strict=True
                )
                if bits & _PRESENT
            }
        return answer, rest


def _sample(bits: int, numbers: Sequence[float], fault: str) -> Sample:
    time_s, age_s, *measured = numbers
    value, velocity, effort, temperature_c, voltage_v, tension_n = (
        number if bits & 1 << bit else None for bit, number in enumerate(measured, start=2)
    )
    valid = bool(bits & _VALID)
    return Sample(value, time_s, valid, age_s, velocity, effort, temperature_c, voltage_v, fault, tension_n)
