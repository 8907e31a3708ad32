"""Registers the environments of shipped robots with gymnasium when it is imported: ``contid/ROBOT-v0``."""

from __future__ import annotations

from typing import Final

from gymnasium.envs.registration import register, registry

from contid.robot_file.load import configs_folder

#: Imported when an environment is made.
ENTRY_POINT: Final = "contid_learn.env:TipEnv"


def environment_ids() -> dict[str, str]:
    """Names of shipped robot files by the id of their environment; emulated twins are left out."""
    names = sorted(file.stem for file in configs_folder().glob("*.yaml") if "." not in file.stem)
    return {f"contid/{name}-v0": name for name in names}


def register_all() -> None:
    """Register every environment; those that are registered stay as they are."""
    for identity, name in environment_ids().items():
        if identity not in registry:
            register(identity, entry_point=ENTRY_POINT, kwargs={"robot": name})


register_all()
