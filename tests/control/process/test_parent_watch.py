"""The signal that the daemon is gone: where it ends the control process at once, and where it is noted."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from contid.control.process.control_process import DaemonGoneError, ParentWatch


def test_only_the_opening_of_buses_is_broken_off_and_once() -> None:
    """What closes them, or is not in `main` yet, would end by the second signal without closing anything."""
    inbox: Any = SimpleNamespace(closed=False)
    watch = ParentWatch(inbox)
    watch.signalled(15, None)
    assert watch.parent_gone
    watch.opens = True
    with pytest.raises(DaemonGoneError):
        watch.signalled(15, None)
    watch.signalled(15, None)
    assert watch.parent_gone
