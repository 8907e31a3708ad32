"""Results of the library have types: a checker sees arrays, and the fields are those that are declared."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
from importlib.resources import files
from pathlib import Path
from typing import assert_type, get_type_hints

import numpy as np
import pytest
from numpy.typing import NDArray

import contid
from contid import Robot, Sim
from contid.api.results import AnswerRecords, PoseRecords


def test_the_fields_are_those_that_are_declared() -> None:
    robot = Robot("finger")
    answer, pose = robot.ik([[30.0, 85.0], [20.0, 90.0]]), robot.fk([60.0, 60.0])
    for found, kind in ((answer, AnswerRecords), (pose, PoseRecords)):
        assert type(found) is kind
        assert found.dtype.names == tuple(get_type_hints(kind))[: len(found.dtype.names or ())]
    assert np.array_equal(answer[1].actuation, answer.actuation[1])
    assert np.array_equal(answer["residual"], answer.residual)
    assert np.array_equal(pickle.loads(pickle.dumps(answer)).actuation, answer.actuation)


def test_a_checker_sees_arrays() -> None:
    """`assert_type` is judged by mypy, which checks this file (tests/test_quality.py)."""
    robot = Robot("finger")
    answer, pose = robot.ik([[30.0, 85.0]]), robot.fk([60.0, 60.0])
    assert_type(answer.actuation, NDArray[np.float64])
    assert_type(answer.converged, NDArray[np.bool_])
    assert_type(pose.tip, NDArray[np.float64])
    with Sim("finger") as sim:
        assert_type(sim.reset(1)["finger"].tip, NDArray[np.float64])
    # Checkers of users look at types of a package with this file only.
    assert files("contid").joinpath("py.typed").is_file()


#: Not for scripts: what `Sim` is to the engine.
OF_THE_ENGINE = {"Sim.event", "Sim.write"}
SCRIPT_OF_ALL = Path(__file__).parent / "public_api.py"


def test_the_script_uses_the_whole_public_library() -> None:
    text = SCRIPT_OF_ALL.read_text()
    public = [name for name in contid.__all__ if not name.startswith("__")]
    names = {
        f"{name}.{each}"
        for name in public
        for each in vars(getattr(contid, name))
        if not each.startswith("_") and name != "Wrench"
    }
    assert not [name for name in names - OF_THE_ENGINE if f".{name.partition('.')[2]}" not in text]
    assert not [name for name in contid.__all__ if name not in text]


@pytest.mark.campaign
def test_pyright_takes_the_whole_public_library(tmp_path: Path) -> None:
    """In its strict mode; `pip install pyright` fetches it, and it needs node."""
    pytest.importorskip("pyright", reason="pip install pyright")
    (tmp_path / "script.py").write_text(SCRIPT_OF_ALL.read_text())
    settings = {"typeCheckingMode": "strict", "include": ["script.py"], "pythonVersion": "3.11"}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings))
    command = [sys.executable, "-m", "pyright", "--pythonpath", sys.executable]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "0 errors" in done.stdout, done.stdout + done.stderr
