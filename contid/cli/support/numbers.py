"""Types of options that are numbers; unlike click's own they refuse ``nan`` and ``inf``."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import click
from click.types import FloatParamType

if TYPE_CHECKING:
    _Tuple = click.ParamType[tuple[float, ...]]
else:  # older releases of click have no type of its value
    _Tuple = click.ParamType


class Number(FloatParamType):
    """A finite number."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number; anything but a finite number is a usage error."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        return number


class NumberRange(click.FloatRange, Number):
    """A finite number in a range."""

    name = "number"


class Numbers(_Tuple):
    """From ``min_count`` to ``max_count`` numbers separated by commas: ``50,70``."""

    name = "numbers"

    def __init__(self, min_count: int, max_count: int, each: FloatParamType) -> None:
        self.min_count, self.max_count, self.each = min_count, max_count, each

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """The numbers; a wrong count, or a number that ``each`` refuses, is a usage error."""
        if isinstance(value, tuple):
            return value
        parts = value.split(",")
        if not self.min_count <= len(parts) <= self.max_count:
            several = self.min_count < self.max_count
            count = f"{self.min_count} to {self.max_count}" if several else f"{self.min_count}"
            self.fail(f"{value!r} is not {count} numbers with commas between.", param, ctx)
        return tuple(self.each.convert(part, param, ctx) for part in parts)


NUMBER: Final = Number()
POSITIVE: Final = NumberRange(min=0, min_open=True)
