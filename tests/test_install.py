"""Without a compiler or the Python headers the package installs, solves in NumPy and reports it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.campaign

ROOT = Path(__file__).parents[1]
HEADERS = Path(sysconfig.get_path("include"))
#: The checkout is installed editable here; its import hook comes before PYTHONPATH.
WITHOUT_CHECKOUT = (
    "import sys; sys.meta_path[:] = [f for f in sys.meta_path if 'Redirecting' not in type(f).__name__]; "
)
POSE = "x_mm,y_mm,z_mm\n10,10,300\n"
PACKAGES = [folder for folder in sys.path if Path(folder).name == "site-packages"]
TRAJECTORY = "t_s,x_mm,y_mm\n0,20,80\n"


def build(folder: Path, *settings: str, prefix: tuple[str, ...] = (), **environment: str) -> Path:
    """The wheel of the checkout, built apart from the build folder of the editable installation."""
    pip = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", str(folder)]
    options = (f"build-dir={folder / 'build'}", *settings)
    arguments = [part for setting in options for part in ("--config-settings", setting)]
    done = subprocess.run(
        [*prefix, *pip, *arguments, str(ROOT)],
        capture_output=True,
        text=True,
        env={**os.environ, **environment},
        timeout=240,
    )
    if done.returncode:
        raise RuntimeError(done.stdout + done.stderr)
    (wheel,) = folder.glob("contid-*.whl")
    return wheel


def run_from(
    wheel: Path, folder: Path, *command: str, **environment: str
) -> subprocess.CompletedProcess[str]:
    """A contid command of the wheel's contents, in a process that sees no checkout."""
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return subprocess.run(
        [sys.executable, "-c", f"{WITHOUT_CHECKOUT}from contid.cli.main import main; main()", *command],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), **environment},
        input=POSE,
        capture_output=True,
        text=True,
        timeout=60,
    )


def assert_usable_without_kernels(wheel: Path, folder: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert not [name for name in names if name.endswith(".so")]
    assert "contid/configs/cbha.yaml" in names
    solved = run_from(wheel, folder, "ik", "cbha", "-")
    assert solved.returncode == 0, solved.stderr
    assert len(solved.stdout.splitlines()) == 2
    (line,) = (line for line in solved.stderr.splitlines() if "NumPy twins" in line)
    assert "apt install g++ python3-dev" in line
    assert "apt install g++ python3-dev" in run_from(wheel, folder, "check", "cbha").stdout
    asked = run_from(wheel, folder, "ik", "cbha", "-", CONTID_PURE_PYTHON="1")
    assert "NumPy twins" not in asked.stderr
    assert asked.stdout == solved.stdout


@pytest.mark.realtime
def test_without_a_compiler_the_package_installs_and_reports_the_twins(tmp_path: Path) -> None:
    wheel = build(tmp_path / "wheel", CXX="/nonexistent", CC="/nonexistent")
    assert_usable_without_kernels(wheel, tmp_path / "site")
    ran = subprocess.run(
        [Path(sys.executable).resolve(), "-m", "contid", "run", "finger", "--mock"],
        cwd=tmp_path / "site",
        # Folders of PYTHONPATH have no import hooks: the child processes do not see the checkout either.
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path / "site"), *PACKAGES])},
        input=TRAJECTORY,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert ran.returncode == 0, ran.stderr
    assert ran.stderr.count("NumPy twins") == 1, ran.stderr  # of the daemon, not of its control process too


def test_without_python_headers_the_package_installs_and_reports_the_twins(tmp_path: Path) -> None:
    hide = f'mount -t tmpfs none {HEADERS} && exec "$@"'
    prefix = ("unshare", "-m", "sh", "-c", hide, "sh")
    if not shutil.which("unshare") or subprocess.run([*prefix, "true"], capture_output=True).returncode:
        pytest.skip("hiding the headers needs the right to mount")
    wheel = build(tmp_path / "wheel", prefix=prefix)
    assert_usable_without_kernels(wheel, tmp_path / "site")


def test_a_published_wheel_is_never_built_without_kernels(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="contid's kernels cannot be built: no C\\+\\+ compiler"):
        build(tmp_path / "wheel", "cmake.define.CONTID_KERNELS=ON", CXX="/nonexistent", CC="/nonexistent")


def test_a_script_in_a_checkout_without_kernels_names_the_remedy(tmp_path: Path) -> None:
    for part in ("contid", "configs"):
        shutil.copytree(ROOT / part, tmp_path / part, ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    shutil.copy(ROOT / "CMakeLists.txt", tmp_path)
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            f"{WITHOUT_CHECKOUT}from contid.kernels import load; load('arc'); load('cosserat')",
        ],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=60,
    )
    (line,) = done.stderr.splitlines()
    assert f"pip install -e {tmp_path}" in line
