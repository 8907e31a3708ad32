"""The options that this extra adds to `contid run`: a policy that drives its robots."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import click

from contid.cli.support.added_options import Watch
from contid.cli.support.parameters import POSITIVE
from contid.errors import require_extra


class PolicyOption:
    """A policy as a client beside a run; see `contid.cli.support.added_options.RunOption`."""

    options = (
        click.Option(
            ["--policy"],
            type=click.Path(exists=True, dir_okay=False),
            help="An ONNX file that moves the robots at its own rate, within their limits; needs --goal.",
        ),
        click.Option(
            ["--goal"],
            metavar="COLUMN=MM,...",
            help="Where --policy is to bring the tips: x_mm=30,y_mm=85; several robots: left.x_mm=...",
        ),
        click.Option(
            ["--policy-for"],
            type=POSITIVE,
            metavar="SECONDS",
            help="End the run when --policy has moved the robots for this time.",
        ),
    )

    def prepare(self, values: Mapping[str, Any], virtual: bool) -> Watch | None:
        """Refuse a policy that cannot be, before the run starts."""
        file = values.get("policy")
        if file is None:
            for name in ("goal", "policy_for"):
                if values.get(name) is not None:
                    raise click.UsageError(f"--{name.replace('_', '-')} is for --policy, which is not given")
            return None
        if virtual:
            raise click.UsageError(
                "--policy needs a daemon in real time; step a TipEnv instead (docs/robots/learning.md)"
            )
        run = click.get_current_context().params
        if run.get("trajectory") is not None:
            raise click.UsageError("--policy and --trajectory both move the robots: leave one out")
        if values.get("goal") is None:
            raise click.UsageError("--policy needs --goal COLUMN=MM,..., where it is to bring the tips")
        require_extra("--policy", "onnxruntime")
        from contid_learn.policy_process import PolicyProcess

        process = PolicyProcess(run["robot_file"], file, values["goal"], values.get("policy_for"))
        return Watch(beside=process.beside, lost=lambda: process.failed)


POLICY: Final = PolicyOption()
