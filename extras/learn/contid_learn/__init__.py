"""Learning on simulated robots: `gymnasium` environments over `contid.Sim`, and policies that drive robots.

    import contid_learn.envs  # registers contid/ROBOT-v0
    import gymnasium

    env = gymnasium.make("contid/finger-v0", task="reach")

See docs/robots/learning.md. The package alone imports no library; its names are imported at first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from contid_learn.env import TipEnv
    from contid_learn.policy_file import Policy, PolicyAbout, write_policy

__all__ = ["Policy", "PolicyAbout", "TipEnv", "write_policy"]

_MODULES: Final = {
    "Policy": "contid_learn.policy_file",
    "PolicyAbout": "contid_learn.policy_file",
    "TipEnv": "contid_learn.env",
    "write_policy": "contid_learn.policy_file",
}


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(
            f"module 'contid_learn' has no attribute {name!r}; public: {', '.join(_MODULES)}"
        )
    value = globals()[name] = getattr(import_module(_MODULES[name]), name)
    return value
