"""Messages of the library for mistakes: what was given, what is allowed."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import contid
from contid import Robot, Sim
from contid.errors import BadInputError, ContidError

HAND, ARM = Robot("hand"), Robot("stiffflop2")
FINGER = HAND["left"]

MISTAKES: dict[str, tuple[Callable[[], object], str]] = {
    "several robots": (lambda: HAND.ik([1, 2]), "has 2 robots: left, right; choose one: robot['left']"),
    "robot": (lambda: HAND["lft"], "no robot 'lft'; allowed: left, right; did you mean 'left'?"),
    "passive": (lambda: Robot("chain")["rope"], "no robot 'rope'; allowed: left, right"),
    "columns": (
        lambda: FINGER.ik([[1, 2, 3]]),
        "tips has shape (1, 3); expected: (2,) or (N, 2) with columns x_mm, y_mm",
    ),
    "scalar": (lambda: FINGER.fk(3.0), "actuation has shape (); expected: (2,) or (N, 2)"),
    "text": (lambda: FINGER.ik("there"), "tips: an array of numbers is needed"),
    "ragged": (lambda: FINGER.ik([[1, 2], [3]]), "tips: an array of numbers is needed"),
    "nan": (
        lambda: ARM.ik([[1.0, 2.0, 3.0], [4.0, math.nan, 6.0], [math.nan, math.nan, math.nan]]),
        "tips: y_mm in row 1 is nan, not a finite number (2 such rows)",
    ),
    "infinite": (lambda: ARM.fk([0, 0, float("inf"), 0, 0, 0]), "s1.p3_bar in row 0 is inf"),
    "huge": (lambda: ARM.ik([1e300, 0, 0]), "x_mm in row 0 is 1e+300, above 1e+10"),
    "seeds": (lambda: FINGER.ik([[1, 2]] * 4, seed=[[1, 2]] * 3), "allowed: (4, 2), or (2,) for all rows"),
    "seed": (lambda: FINGER.ik([1, 2], seed="last"), "seed='last'; allowed: an array, None, 'previous'"),
    "direction": (
        lambda: FINGER.ik([1, 2], direction=[0, 1]),
        "takes no direction; allowed: actuation, arcs, tip",
    ),
    "zero": (
        lambda: ARM.ik([[1, 2, 3]] * 2, direction=[[0, 0, 1], [0, 0, 0]]),
        "direction: row 1 is the zero vector",
    ),
    "load": (lambda: FINGER.fk([1, 2], load=[0, 0, 1]), "model rack_finger of left takes no load"),
    "rate": (lambda: Sim("finger", rate_hz=0), "rate_hz=0: allowed: above 0, up to 1000"),
    "points": (lambda: FINGER.backbone([60, 60], 1), "points=1: a backbone needs at least 2"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_the_message_names_what_is_allowed(mistake: str) -> None:
    call, message = MISTAKES[mistake]
    with pytest.raises(ContidError, match=re.escape(message)) as caught:
        call()
    assert isinstance(caught.value, ValueError)


def test_an_unknown_robot_names_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(ContidError, match="did you mean 'stiffflop2'"):
        Robot("stifflop2")
    (tmp_path / "arm.yaml").write_text("contid: 1\nnam: arm\n")
    with pytest.raises(BadInputError, match=r"arm\.yaml:2:1: .*did you mean 'name'"):
        Robot(tmp_path / "arm.yaml")


@pytest.mark.process
def test_importing_contid_imports_no_library() -> None:
    code = (
        "import sys, contid; heavy = {'numpy', 'pydantic', 'contid.api', 'contid.client'} & {*sys.modules}; "
        "assert not heavy, heavy; from contid import Robot, Client; assert Client and Robot('hand')"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_public_names_are_typed_and_complete() -> None:
    stub = Path(contid.__file__).with_suffix(".pyi").read_text()
    for name in contid.__all__:
        assert getattr(contid, name)
        assert name in dir(contid)
        assert re.search(rf"\b{name}\b(?: as {name}|: str)", stub)
    with pytest.raises(AttributeError, match="public: Client, ElasticRod, Robot, Session, Sim"):
        contid.Robbot  # type: ignore[attr-defined]
