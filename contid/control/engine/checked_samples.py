"""What a driver answered, before anything computes with it: a driver may be anybody's.

An answer that is no mapping costs the bus; a sample that is none costs the robot of its axis, as a fault of
the device with the text of the answer.
"""

from __future__ import annotations

from collections.abc import Mapping
from operator import attrgetter
from typing import Any, Final

import numpy as np

from contid.hal import REPORTED, Bus, Sample
from contid.targets import are_numbers

#: The parts of a sample; the numbers from the third one on may be absent.
_PARTS: Final = attrgetter("fault", "valid", "time_s", "age_s", "value", *REPORTED)
#: Types of the parts of samples that were examined.
_KNOWN: Final[set[tuple[type, ...]]] = set()


def checked_samples(bus: Bus, answer: Any) -> Mapping[str, Sample]:
    """The samples of the axes of a bus; every one that is none is a fault of its axis.

    Raises:
        TypeError: the answer is no mapping.
    """
    if not isinstance(answer, Mapping):
        raise TypeError(f"the driver answered {_shown(answer)}, not a sample of every axis")
    if len(answer) <= len(bus.axes) and all(map(_is_sample, map(answer.get, bus.axes))):
        return answer
    return {
        axis: sample if _is_sample(sample := answer[axis]) else _none(sample)
        for axis in bus.axes
        if axis in answer
    }


def _is_sample(sample: Any) -> bool:
    return isinstance(sample, Sample) and (tuple(map(type, _PARTS(sample))) in _KNOWN or _examined(sample))


def _examined(sample: Sample) -> bool:
    """True for a sample; the types of its parts are known from then on."""
    fault, valid, *numbers = _PARTS(sample)
    sound = isinstance(fault, str) and isinstance(valid, int | np.bool_)
    sound &= are_numbers(numbers[:2]) and are_numbers([each for each in numbers[2:] if each is not None])
    if sound:
        _KNOWN.add(tuple(map(type, _PARTS(sample))))
    return sound


def _none(answer: Any) -> Sample:
    """The sample of an axis of which there is none."""
    fault = f"the driver answered {_shown(answer)}, not a sample"
    return Sample(None, time_s=0.0, valid=False, age_s=0.0, fault=fault)


def _shown(answer: Any) -> str:
    """The answer and its type, for messages."""
    return f"{str(answer)[:200]!r} ({type(answer).__name__})"
