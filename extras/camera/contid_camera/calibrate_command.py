"""``contid calibrate camera``: focal lengths, centre and distortion from a chessboard."""

from __future__ import annotations

import re
from pathlib import Path

import click

from contid.cli.support.parameters import NewFile, NumberRange


@click.command()
@click.argument("source")
@click.option("--board", required=True, help="Inner corners of the chessboard, such as 9x6.")
@click.option("--square-mm", required=True, type=NumberRange(0.5, 1000.0), help="Side of a square.")
@click.option(
    "--output",
    "-o",
    required=True,
    type=NewFile(path_type=Path, dir_okay=False),
    help="Camera file, for the key `camera` of the setup.",
)
@click.option(
    "--images",
    default=600,
    show_default=True,
    type=click.IntRange(8, 100_000),
    help="Greatest number of images to look at.",
)
def command(source: str, board: str, square_mm: float, output: Path, images: int) -> None:
    """Calibrate a camera from SOURCE: its number, a video, or a folder of images of a chessboard.

    Show the board at many places, also near the edges of the image, and tilted to all sides.
    """
    from itertools import islice

    from contid.whole_file import replacing
    from contid_camera.extra import require_extra

    require_extra()
    from contid_camera.board import MIN_COVER, calibrated
    from contid_camera.frames import frames

    match = re.fullmatch(r"(\d{1,2})x(\d{1,2})", board)
    columns, rows = (int(each) for each in match.groups()) if match else (0, 0)
    if min(columns, rows) < 3:
        raise click.BadParameter(
            f"{board!r} is not COLUMNSxROWS of inner corners, 3 at least", param_hint="--board"
        )
    looked = (image for image, _ in islice(frames(source), images))
    camera, used, cover = calibrated(looked, columns, rows, square_mm / 1e3)
    with replacing(output) as file:
        file.write(camera.text().encode())
    click.echo(f"{output}: {used} images, corners {camera.error_px:.2f} px off")
    if cover < MIN_COVER:
        click.echo(
            f"the board covered only {100 * cover:.0f} % of the image: towards the edges the distortion is "
            "a guess",
            err=True,
        )
