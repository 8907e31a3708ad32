"""The options that this extra adds to `contid move`: a named pose as its target."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

if TYPE_CHECKING:
    from contid.client import Client


class PoseOption:
    """A saved pose; see `contid.cli.support.added_options.GoalOption`."""

    options = (
        click.Option(["--pose"], help="Go to this named pose instead of a point."),
        click.Option(
            ["--poses"],
            type=click.Path(path_type=Path, dir_okay=False),
            help="File of --pose; default ROBOTFILE.poses.yaml or poses.yaml beside the daemon's robot file.",
        ),
    )

    def given(self, values: Mapping[str, Any]) -> bool:
        """True when a pose is named."""
        if values["poses"] is not None and values["pose"] is None:
            raise click.UsageError("--poses names the file of --pose")
        return values["pose"] is not None

    def target(self, client: Client, values: Mapping[str, Any]) -> dict[str, float]:
        """The target of the pose, compared with the robots of the daemon."""
        from contid_hands.teach.check_targets import check_targets
        from contid_hands.teach.pose_file import read_pose_file
        from contid_hands.teach.pose_store import default_pose_file

        describe = client.describe()
        read = read_pose_file(values["poses"] or default_pose_file(Path(describe["file"])))
        target = dict(read.pose(values["pose"]).target)
        check_targets(read, describe, {values["pose"]})
        return target


POSE: Final = PoseOption()
