"""Types of options that are numbers: what click lets through as one, ``nan`` and ``inf``, is refused."""

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
        """The number; a value that is none, or not a finite one, is a usage error with the option's name."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        return number


class NumberRange(click.FloatRange, Number):
    """A finite number in a range: click compares with its ends what `Number` lets through."""

    name = "number"


class Numbers(_Tuple):
    """From ``least`` to ``most`` numbers separated by commas: ``50,70``."""

    name = "numbers"

    def __init__(self, least: int, most: int, each: FloatParamType) -> None:
        self.least, self.most, self.each = least, most, each

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """The numbers; another count, or one of them refused by ``each``, is a usage error."""
        if isinstance(value, tuple):
            return value
        parts = value.split(",")
        if not self.least <= len(parts) <= self.most:
            count = f"{self.least} to {self.most}" if self.least < self.most else f"{self.least}"
            self.fail(f"{value!r} is not {count} numbers with commas between.", param, ctx)
        return tuple(self.each.convert(part, param, ctx) for part in parts)


NUMBER: Final = Number()
POSITIVE: Final = NumberRange(min=0, min_open=True)
