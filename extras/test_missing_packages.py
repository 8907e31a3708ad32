"""A base install runs robots; what needs an extra names it. The packages of all extras are hidden here."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from contid.errors import EXTRAS
from contid.robot_file.load import load_named
from contid.session.read import Session
from tests.support.plugins.forked import THIS_TREE
from tests.support.plugins.shell import contid_for_shells
from tests.support.plugins.starter import LATE

pytestmark = pytest.mark.process

ROOT = Path(__file__).parent.parent
# Processes that a command starts hide them as well: they import this module too. Commands fork where the
# packages were imported before: these are imported anew, and with them all modules of contid, which could
# have them already. In campaigns what reads a recording starts as users start it.
HIDE = """
import sys

for name, module in [*sys.modules.items()]:
    own = name.partition(".")[0]
    code = (getattr(module, "__file__", None) or "").endswith(".py")
    if own in PACKAGES or (own.startswith("contid") and code):
        del sys.modules[name]

class Hidden:
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        if name.partition(".")[0] in PACKAGES:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return None

sys.meta_path.insert(0, Hidden)
"""
CIRCLE = "contid path circle --center 50,70 --radius 5 --period 2 --for hand"
RUN_AND_READ = [
    "contid check hand c.csv",
    "contid run hand --virtual --trajectory c.csv --record c.mcap",
    "contid session info c.mcap",
    "contid replay c.mcap",
    "contid session export c.mcap --csv table.csv",
    "contid ik hand c.csv",
]
#: Commands one after the other, as `contid` runs them, in a process that imports once.
ONE_PROCESS = """
import sys
from contid.cli.main import main

for line in sys.argv[1:]:
    sys.argv = line.split()
    try:
        main()
    except SystemExit as done:
        if done.code:
            sys.exit(f"{line}: {done.code}")
"""


def hide(packages: set[str], folder: Path) -> Path:
    (folder / "hide").mkdir()
    (folder / "hide" / "sitecustomize.py").write_text(LATE + HIDE.replace("PACKAGES", repr(packages)))
    return folder


@pytest.fixture
def hidden(tmp_path: Path) -> Path:
    return hide(set(EXTRAS), tmp_path)


@pytest.fixture
def core(tmp_path: Path) -> Path:
    """The folder of a run of the core alone: no package of `extras` is there."""
    packages = {path.name for path in ROOT.glob("extras/*/contid_*")}
    assert len(packages) > 15
    return hide(packages, tmp_path)


def shell(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    commands = folder / "bin"
    commands.mkdir(exist_ok=True)
    with contid_for_shells(commands):
        return subprocess.run(
            ["bash", "-c", f"set -o pipefail; {line}"],
            cwd=folder,
            env={
                **os.environ,
                "PATH": f"{commands}:{os.environ['PATH']}",
                "PYTHONPATH": os.pathsep.join([str(folder / "hide"), THIS_TREE]),
                "XDG_RUNTIME_DIR": str(folder),
            },
            capture_output=True,
            text=True,
            timeout=120,
            stdin=subprocess.DEVNULL,
            check=False,
        )


def test_the_packages_are_hidden(hidden: Path) -> None:
    done = shell(f"'{sys.executable}' -c 'import scipy'", hidden)
    assert "ModuleNotFoundError: No module named 'scipy'" in done.stderr


@pytest.mark.parametrize(
    "line",
    [
        f"{CIRCLE} | contid run hand --mock",
        pytest.param(
            f"{CIRCLE} > c.csv && {shlex.join([sys.executable, '-c', ONE_PROCESS, *RUN_AND_READ])}",
            id="run and read",
        ),
        pytest.param(
            " && ".join([f"{CIRCLE} > c.csv", *RUN_AND_READ]),
            marks=[pytest.mark.campaign, pytest.mark.true_process],
            id="as a user",
        ),
        "contid new mine --from finger && contid check mine.yaml && contid schema && contid --help",
        "contid calibrate --help && contid calibrate modulus --help && contid view --help",
    ],
)
def test_the_base_install_runs_robots(line: str, hidden: Path) -> None:
    done = shell(line, hidden)
    assert done.returncode == 0, done.stderr


def test_the_core_alone_runs_records_and_stops(core: Path) -> None:
    (core / "rows.csv").write_text("t_s,x_mm,y_mm\n0,50,75\n0.2,51,75\n")
    done = shell(
        "contid check finger && contid check finger rows.csv"
        " && contid run finger --virtual --trajectory rows.csv --record s.mcap && contid --help",
        core,
    )
    assert done.returncode == 0, done.stderr
    assert "home" not in done.stdout.split("Usage")[1]
    ticks = sum(entry.values is not None for entry in Session(core / "s.mcap").entries())
    assert ticks > 100
    refused = shell("contid estop", core)
    assert refused.returncode == 2
    assert "daemon" in refused.stderr


@pytest.mark.parametrize("line", ["run arm.yaml --virtual --trajectory rows.csv", "run arm.yaml --mock"])
def test_a_simulated_body_without_its_package_is_refused(line: str, core: Path) -> None:
    """In real time the message came after another one, "the time of a tick was not measured"."""
    text = load_named("stiffflop2").text
    simulated = text.replace("    stop: {on_end", "    sim: {payload_g: 10}\n    stop: {on_end", 1)
    assert simulated != text
    (core / "arm.yaml").write_text(simulated)
    names = ",".join(f"s{section}.p{number}_bar" for section in (1, 2) for number in (1, 2, 3))
    rows = "".join(f"{time_s},0.1,0.1,0.1,0.1,0.1,0.1\n" for time_s in (0.0, 0.2))
    (core / "rows.csv").write_text(f"t_s,{names}\n{rows}")
    done = shell(f"contid {line}", core)
    assert done.returncode == 2
    assert done.stderr.strip() == (
        "contid: arm: its key `sim` needs the package contid_emulate, which is not installed; "
        "`pip install --force-reinstall contid` installs it"
    )


@pytest.mark.parametrize("line", ["contid check", "contid run --mock"])
@pytest.mark.parametrize(
    ("name", "needed"),
    [
        ("chain", "robots.rope: its model `chain` needs the package contid_ropes"),
        ("hand", "its key `clearance` needs the package contid_clearance"),
        ("trunk", "robots.arm: its model `tendon.driven` needs the package contid_tendons"),
    ],
)
def test_a_file_whose_watch_is_missing_is_refused_before_a_device_is_opened(
    line: str, name: str, needed: str, core: Path
) -> None:
    """In real time the run began, ended with a fault before its first tick, and gave exit code 3."""
    done = shell(f"{line} {name}", core)
    assert done.returncode == 2
    (message,) = done.stderr.splitlines()
    assert f"{needed}, which is not installed; `pip install" in message


@pytest.mark.parametrize(
    ("line", "package"),
    [
        ("contid check finger --budget", "contid check --budget needs the package contid_sessions"),
        (
            "contid run finger --virtual --stretch --trajectory fast.csv",
            "--stretch needs the package contid_paths",
        ),
    ],
)
def test_an_option_whose_package_is_missing_is_refused_with_the_remedy(
    line: str, package: str, core: Path
) -> None:
    (core / "fast.csv").write_text("t_s,left_mm,right_mm\n0,60,60\n0.2,60,60\n0.25,75,60\n0.3,60,60\n")
    done = shell(line, core)
    assert done.returncode == 2
    assert (
        f"{package}, which is not installed; `pip install --force-reinstall contid` installs it"
        in done.stderr
    )


@pytest.mark.parametrize(
    "name",
    [
        "home",
        "replay",
        "session",
        *(
            pytest.param(each, marks=pytest.mark.campaign)
            for each in ("fault", "schema", "shape", "doctor", "new", "ik")
        ),
    ],
)
def test_a_command_whose_package_is_missing_is_refused_with_the_remedy(name: str, core: Path) -> None:
    done = shell(f"contid {name} finger", core)
    assert done.returncode == 2
    assert (
        f"contid {name}` is not installed; `pip install --force-reinstall contid` installs it" in done.stderr
    )


@pytest.mark.parametrize(
    ("line", "extra"),
    [
        ("contid run finger --mock --view serve", "view"),
        ("contid run finger --mock --panel", "panel"),
        ("contid fleet init ca --fleet lab", "fleet"),
        ("touch c.mcap && contid view c.mcap", "view"),
        ("contid reach hand", "plots"),
        (f"{CIRCLE} --fastest", "retime"),
        ("contid panel", "panel"),
        ("contid demo", "panel"),
        ("contid track --camera tip.avi --print", "track"),
        ("contid calibrate camera 0 --board 9x6 --square-mm 20 -o c.yaml", "track"),
    ],
)
def test_a_missing_extra_is_named(line: str, extra: str, hidden: Path) -> None:
    done = shell(line, hidden)
    assert done.returncode == 2
    assert f"pip install 'contid[{extra}]'" in done.stderr
    assert "Traceback" not in done.stderr


def test_every_extra_that_a_message_names_is_declared() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    distributions = {
        "cv2": "opencv-python-headless",
        "foxglove": "foxglove-sdk",
        "rerun": "rerun-sdk",
        "zenoh": "eclipse-zenoh",
    }
    for package, extra in EXTRAS.items():
        name = distributions.get(package, package)
        assert any(each.startswith(f"{name}>=") for each in extras[extra]), (package, extra)
        assert not any(each.startswith(f"{name}>=") for each in project["dependencies"]), package
        assert extra in extras["all"][0]
