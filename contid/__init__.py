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
    "ElasticRod": "contid.api.rod",
    "Robot": "contid.api.robot",
    "Session": "contid.session.read",
    "Sim": "contid.api.simulated",
    "Wrench": "contid.api.rod",
}


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module 'contid' has no attribute {name!r}; public: {', '.join(_MODULES)}")
    value = globals()[name] = getattr(import_module(_MODULES[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULES})
