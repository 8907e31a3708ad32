"""Named poses and sequences in a YAML file beside the robot file.

    contid_poses: 1
    poses:
      open: {target: {x_mm: 40, y_mm: 75}}
    sequence:
      - {pose: open, time_s: 2, wait_s: 0.5}
      - {loop: 3, steps: [{pose: open}, {trajectory: wave.csv}]}

A target has columns of a trajectory with their units, as in ``contid move``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from contid.errors import BadInputError, ContidError, first_findings
from contid.robot_file.base import Strict
from contid.robot_file.findings import allowed_names, validated
from contid.robot_file.positions import Document, KeyPath, read_document, read_text

#: A wait or a motion of at most an hour [s]; a longer time was probably written in milliseconds.
Seconds = Annotated[float, Field(ge=0.0, le=3600.0)]
MotionTime = Annotated[float, Field(ge=0.01, le=3600.0)]
#: A name that needs no quotes in a shell; the pattern is of the whole name.
NAME_PATTERN: Final = r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}"
PoseName = Annotated[str, Field(pattern=f"^{NAME_PATTERN}$")]


class NamedPose(Strict):
    """A named pose.

    Attributes:
        target: columns of a trajectory with their values.
        saved: when, by what and for which robot file it was saved.
    """

    target: Annotated[dict[str, float], Field(min_length=1)]
    saved: str = ""


class SequenceStep(Strict):
    """One step of a sequence: a pose, a trajectory, a loop, or a wait alone.

    Attributes:
        pose: name of the pose to go to.
        time_s: duration of the motion to the pose; None: as fast as the rates of the robot file allow.
        trajectory: CSV to play, relative to the folder of the pose file.
        wait_s: wait after the motion, the trajectory or the loop; None without.
        loop: how many times ``steps`` are done.
        steps: steps of the loop.
    """

    pose: str | None = None
    time_s: MotionTime | None = None
    trajectory: str | None = None
    wait_s: Seconds | None = None
    loop: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    steps: Annotated[tuple[SequenceStep, ...], Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        kinds = [key for key in ("pose", "trajectory", "loop") if getattr(self, key) is not None]
        if len(kinds) > 1:
            raise ValueError(f"a step has one of pose, trajectory and loop, not {' and '.join(kinds)}")
        if (self.loop is None) != (self.steps is None):
            raise ValueError("loop and steps belong together: {loop: 3, steps: [...]}")
        if not kinds and self.wait_s is None:
            raise ValueError("a step needs pose, trajectory, loop or wait_s")
        if self.time_s is not None and self.pose is None:
            raise ValueError("time_s belongs to a pose; rows of a trajectory have their own times")
        return self


class PoseFileContents(Strict):
    """A whole pose file after validation.

    Attributes:
        contid_poses: version of the format.
        robot_file: name of the robot file that the poses belong to, "" when it is not stated.
        poses: poses by name.
        sequence: steps in their order.
    """

    contid_poses: Literal[1]
    robot_file: str = ""
    poses: dict[PoseName, NamedPose] = Field(default_factory=dict)
    sequence: tuple[SequenceStep, ...] = ()


@dataclass(frozen=True, slots=True)
class PoseFile:
    """A pose file with the places of its keys.

    Attributes:
        path: path of the file.
        contents: what it contains, validated.
        document: its text with the line and column of every key, for findings.
    """

    path: Path
    contents: PoseFileContents
    document: Document

    def pose(self, name: str) -> NamedPose:
        """A pose by name.

        Raises:
            ContidError: the file has no such pose; the message lists those it has.
        """
        found = self.contents.poses.get(name)
        if found is None:
            raise ContidError(f"{self.path}: {self.no_pose(name)}")
        return found

    def no_pose(self, name: str) -> str:
        """The message about a name that no pose has."""
        names = allowed_names(self.contents.poses, name) if self.contents.poses else "the file has no poses"
        return f"no pose {name!r}; {names}"

    def located_steps(self) -> Iterator[tuple[KeyPath, SequenceStep]]:
        """Every step of the sequence with its path in the document; those of a loop once, after the loop."""

        def below(path: KeyPath, steps: tuple[SequenceStep, ...]) -> Iterator[tuple[KeyPath, SequenceStep]]:
            for number, step in enumerate(steps):
                here = (*path, number)
                yield here, step
                yield from below((*here, "steps"), step.steps or ())

        return below(("sequence",), self.contents.sequence)


def read_pose_file(path: Path) -> PoseFile:
    """Read and check a pose file.

    Raises:
        BadInputError: with every finding, ``file:line:column: what; allowed``.
        ContidError: the file cannot be read.
    """
    return parse_pose_file(read_text(path), path)


def parse_pose_file(text: str, path: Path) -> PoseFile:
    """Check the text of a pose file; raises as `read_pose_file`."""
    document = read_document(text, str(path))
    file = PoseFile(path, validated(document, PoseFileContents), document)
    findings = []
    for at, step in file.located_steps():
        if step.pose is not None and step.pose not in file.contents.poses:
            findings.append(document.at_value((*at, "pose"), file.no_pose(step.pose)))
        if step.trajectory is not None and (message := _missing(path.parent / step.trajectory)):
            findings.append(document.at_value((*at, "trajectory"), message))
    if findings:
        raise BadInputError(first_findings(findings))
    return file


def _missing(path: Path) -> str:
    """Why there is no file to read; empty where there is one."""
    try:
        return "" if path.is_file() else f"no file {path}"
    except OSError as error:  # a name that is too long, or a folder that may not be searched
        return f"{path}: {error.strerror}"
