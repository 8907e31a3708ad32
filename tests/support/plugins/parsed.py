"""The text of a robot file is scanned once in each process.

PyYAML's scanner, which is no part of contid, takes two thirds of the time of loading one, and tests load the
same few files thousands of times. Only whole texts without a mistake are kept, as PyYAML's events.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, Final

import yaml

#: Longer texts are those of tests of long files, which are read once.
LONGEST: Final = 10_000
_parse = yaml.parse


@lru_cache(64)
def _events(text: str) -> tuple[yaml.Event, ...]:
    return tuple(_parse(text, Loader=yaml.BaseLoader))


def parse(stream: Any, Loader: Any = yaml.Loader) -> Iterator[yaml.Event]:
    """As `yaml.parse`."""
    if Loader is not yaml.BaseLoader or not isinstance(stream, str) or len(stream) > LONGEST:
        return iter(_parse(stream, Loader=Loader))
    try:
        return iter(_events(stream))
    except yaml.YAMLError:  # the events before the mistake count
        return iter(_parse(stream, Loader=Loader))


yaml.parse = parse
