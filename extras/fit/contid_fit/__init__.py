"""Parameters of models fitted to measurements, and the force on a tip estimated from them."""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "calibrate": ("contid_fit.commands", "fit a model's parameters to measurements"),
    "session load": ("contid_fit.commands.session_load", "the force on the tip of a pneumatic arm"),
}
