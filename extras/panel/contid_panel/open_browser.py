"""Opening the page in a browser: its command line, which every user can read, has no token."""

from __future__ import annotations

import html
import os
import subprocess
import tempfile
import threading
import webbrowser
from pathlib import Path
from typing import Final

#: How long the file stays that leads to the page: a browser may start slowly.
KEPT_S: Final = 30
_PAGE: Final = """<!doctype html>
<meta charset="utf-8"><meta name="referrer" content="no-referrer"><title>contid panel</title>
<meta http-equiv="refresh" content="0; url={url}"><a href="{url}">contid panel</a>
"""


def open_browser(url: str) -> None:
    """Open a URL by a file that only this user can read; returns at once, a browser may stay."""
    threading.Thread(target=_open, args=(url,), daemon=True).start()


def _open(url: str) -> None:
    # Browsers in a sandbox (snap) see the home folder, not its hidden folders nor that of temporary files.
    home = Path.home()
    folder = tempfile.mkdtemp(prefix="contid-panel-", dir=home if os.access(home, os.W_OK) else None)
    # A process of its own: it removes the file also when the panel has ended.
    remover = ["sh", "-c", 'sleep "$0"; rm -rf "$1"', str(KEPT_S), folder]
    null = subprocess.DEVNULL
    subprocess.Popen(remover, stdin=null, stdout=null, stderr=null, start_new_session=True)
    page = Path(folder) / "open.html"
    page.write_text(_PAGE.format(url=html.escape(url)), "utf-8")
    webbrowser.open(page.as_uri())
