"""Commands with options that extras add, by objects in a group of entry points."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import click

from contid import entry_points

if TYPE_CHECKING:
    from contid.client import Client
    from contid.control.daemon.interfaces import RunObserver


class ExtendedCommand(click.Command):
    """A command with options of extras; each object of the group has ``options``, and is cheap to import."""

    def __init__(self, *args: Any, group: str, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._group = group

    @cached_property
    def added(self) -> Mapping[str, Any]:
        """The objects of the group by name."""
        return entry_points.load_all(self._group)

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Arguments and options, those of extras before ``--help``."""
        own = super().get_params(ctx)
        return [*self.params, *(each for added in self.added.values() for each in added.options)] + [
            each for each in own if each not in self.params
        ]


@dataclass(frozen=True, slots=True)
class Watch:
    """What watches a run.

    Attributes:
        observer: reads the records; None for a process that is a client.
        beside: starts a process beside a run in real time, from the path of its socket, until it ends.
        lost: after the run: which output is incomplete, "" when none is.
    """

    observer: RunObserver | None = None
    beside: Callable[[Path], AbstractContextManager[None]] | None = None
    lost: Callable[[], str] = lambda: ""


class RunOption(Protocol):
    """Options of `contid run` that make something watch it: an object of the group ``contid.observers``."""

    options: Sequence[click.Option]

    def prepare(self, values: Mapping[str, Any], virtual: bool) -> Watch | None:
        """Refuse, before anything starts, what cannot be; None when the options are not given."""
        ...


class GoalOption(Protocol):
    """Options of `contid move` that name its target: an object of the group ``contid.goals``."""

    options: Sequence[click.Option]

    def given(self, values: Mapping[str, Any]) -> bool:
        """True when the options name a target."""
        ...

    def target(self, client: Client, values: Mapping[str, Any]) -> dict[str, float]:
        """The columns of the target, compared with the robots of the daemon."""
        ...
