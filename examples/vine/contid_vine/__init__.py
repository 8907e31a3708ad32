"""A model of another distribution: the vine of docs/models.md."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contid_vine.description import Vine

if TYPE_CHECKING:
    from contid_vine.model import VineModel


class VinePlugin:
    """The object of the entry point."""

    description = Vine

    def build(self, robot: Vine) -> VineModel:
        """The arithmetic, imported only here."""
        from contid_vine.model import VineModel

        return VineModel(robot)


MODEL = VinePlugin()
