"""contid: a daemon that makes continuum robots move.

    from contid import Client, ElasticRod, Robot, Session, Sim, Wrench

Arrays are in the units of robot files (mm, bar, deg, N, s), or in SI with ``si=True``; see docs/library.md.
"""

from __future__ import annotations

from importlib import import_module

__version__ = "0.1.0"

__all__ = ["Client", "ElasticRod", "Robot", "Session", "Sim", "Wrench", "__version__"]

#: Public names and their modules, imported at first use: ``import contid`` itself imports no library.
_MODULES = {
    "Client": "contid.client",
    "Robot": "contid.api.robot",
    "Session": "contid.session.read",
}
#: Public names of the extra `library`: objects of the group ``contid.library``.
_LIBRARY = ("ElasticRod", "Sim", "Wrench")


def __getattr__(name: str) -> object:
    if name in _MODULES:
        value = globals()[name] = getattr(import_module(_MODULES[name]), name)
        return value
    if name in _LIBRARY:
        value = globals()[name] = _of_library(name)
        return value
    public = ", ".join(sorted({*_MODULES, *_LIBRARY}))
    raise AttributeError(f"module 'contid' has no attribute {name!r}; public: {public}")


def _of_library(name: str) -> object:
    from contid.entry_points import LIBRARY, required

    return required(LIBRARY, name, f"contid.{name}", "library")


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULES, *_LIBRARY})
