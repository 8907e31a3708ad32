"""Entry point of the ``contid`` command: Ctrl-C ends it without a traceback, also while it imports."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType
from typing import NoReturn

#: Exit code after Ctrl-C, as shells report it: 128 + SIGINT.
INTERRUPTED = 130


def _interrupted(_signal: int, _frame: FrameType | None) -> NoReturn:
    raise SystemExit(INTERRUPTED)


def main() -> NoReturn:
    """Run the command line."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupted)
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # searching for them takes 10 to 50 ms
    # Threads of a linear-algebra library wait for one another by spinning: fits took three times as long.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from contid.cli.main import main as run

    if signal.getsignal(signal.SIGINT) is _interrupted:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        run()
    except KeyboardInterrupt:  # between the handler above and the one of the command
        sys.exit(INTERRUPTED)
    except Exception as error:
        # Code that is compiled makes an error of its own of Ctrl-C, as pydantic while its classes are built.
        if "KeyboardInterrupt" not in str(error):
            raise
        sys.exit(INTERRUPTED)
    finally:
        # A further Ctrl-C would only add a traceback: the exit takes milliseconds.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        _give_up_unwritten_messages()


def _give_up_unwritten_messages() -> None:
    """Messages that stderr did not take do not change the exit code; from Python 3.13 on they would (120)."""
    if sys.stderr is not None:
        try:
            sys.stderr.flush()
        except (OSError, ValueError):  # full or gone; closed
            sys.stderr = None
