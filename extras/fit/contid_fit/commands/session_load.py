"""``contid session load``: the force on the tip of a pneumatic arm, from a recording."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click

from contid.cli.support.parameters import POSITIVE, SESSION
from contid.cli.support.streams import counting


@click.command()
@SESSION
@click.option(
    "--unloaded",
    required=True,
    type=click.Path(exists=True, dir_okay=False),
    help="Session without load: rests at many pressures, with measured tips.",
)
@click.option("--robot", help="Name of the arm; needed where there are several.")
@click.option(
    "--noise-mm", type=POSITIVE, default=0.3, show_default=True, help="Standard deviation of a measured tip."
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object per rest.")
def command(session_file: str, unloaded: str, robot: str | None, noise_mm: float, as_json: bool) -> None:
    """Estimate the force on the tip at every rest of SESSION_FILE, with its 95 % interval.

    A rest is an interval of constant commands with measured tips. The error of the model is identified in
    another session of the same arm without load, so that it is not reported as a load. For model cosserat.
    """
    from contid.session.read import Session
    from contid_fit.sense.session_loads import rod_of, session_calibration, session_loads

    noise_m = noise_mm / 1e3
    with counting("ticks read") as count:
        reference = Session(Path(unloaded), count)
        name, arm = rod_of(reference.robot_file(), robot)
        calibration = session_calibration(reference, name, arm, noise_m)
        session = Session(Path(session_file), count)
        if name not in session.robots:
            raise click.ClickException(f"{session_file}: no robot {name!r}")
        loads_at_rests = list(session_loads(session, name, arm, calibration, noise_m))
    click.echo(
        f"{name}: {calibration.poses} rests without load; the tip of the model was off by "
        f"{calibration.before_m * 1e3:.3g} mm rms, corrected by {calibration.residual_m * 1e3:.3g} mm",
        err=True,
    )
    for load in loads_at_rests:
        if as_json:
            click.echo(json.dumps(asdict(load)))
            continue
        force = ", ".join(f"{v:.4f}" for v in load.force_n)
        half = ", ".join(f"{v:.4f}" for v in load.interval_n)
        click.echo(
            f"{load.start_s:.2f} to {load.end_s:.2f} s: "
            f"{load.mass_g:.2f} g ± {load.mass_interval_g:.2f} g along gravity; "
            f"force ({force}) N ± ({half}) N" + ("" if load.converged else "; not converged")
        )
    if not loads_at_rests:
        raise click.ClickException(f"{session_file}: {name} never rests with measured tips")
