"""Without its kernels contid reports in one line what is missing and how to get it, built and later."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from importlib.util import find_spec
from pathlib import Path

import pytest

from contid.kernels import KERNELS

pytestmark = pytest.mark.campaign

ROOT = Path(__file__).parents[1]
HEADERS = Path(sysconfig.get_path("include"))
#: The checkout is installed editable here; its import hook comes before PYTHONPATH.
WITHOUT_CHECKOUT = (
    "import sys; sys.meta_path[:] = [f for f in sys.meta_path if 'Redirecting' not in type(f).__name__]; "
)
POSE = "x_mm,y_mm,z_mm\n10,10,300\n"
TRAJECTORY = "t_s,x_mm,y_mm\n0,20,80\n"
PACKAGES = [folder for folder in sys.path if Path(folder).name == "site-packages"]


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


@pytest.fixture
def without(tmp_path: Path) -> Path:
    """An installed package whose kernels are gone: the folder for PYTHONPATH."""
    shutil.copytree(
        ROOT / "contid", tmp_path / "contid", ignore=shutil.ignore_patterns("*.so", "__pycache__", "kernels")
    )
    (tmp_path / "contid" / "kernels").mkdir()
    shutil.copy(ROOT / "contid" / "kernels" / "__init__.py", tmp_path / "contid" / "kernels")
    shutil.copytree(ROOT / "configs", tmp_path / "contid" / "configs")
    shutil.copytree(ROOT / "drivers" / "contid_drivers", tmp_path / "contid_drivers")
    return tmp_path


def python(folder: Path, code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Python code in a process that sees the packages of a folder, and no checkout."""
    return subprocess.run(
        [sys.executable, "-c", WITHOUT_CHECKOUT + code, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        input=TRAJECTORY if "run" in arguments else POSE,
        capture_output=True,
        text=True,
        timeout=60,
    )


def command(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return python(folder, "from contid.cli.main import main; main()", *arguments)


def assert_one_located_error(done: subprocess.CompletedProcess[str], folder: Path, remedy: str) -> None:
    """One line on stderr: where, what, and how to get it; exit code 2."""
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert f"{folder / 'contid' / 'kernels'}: contid's kernel '" in line
    assert "is not compiled: " in line
    assert remedy in line


def test_without_a_compiler_the_build_ends_with_the_remedy(tmp_path: Path) -> None:
    message = r"kernels cannot be built without a C\+\+\s+compiler\s+\(Debian:\s+apt\s+install\s+g\+\+\)"
    with pytest.raises(RuntimeError, match=message):
        build(tmp_path / "wheel", CXX="/nonexistent", CC="/nonexistent")


def test_without_python_headers_the_build_ends_with_the_remedy(tmp_path: Path) -> None:
    hide = f'mount -t tmpfs none {HEADERS} && exec "$@"'
    prefix = ("unshare", "-m", "sh", "-c", hide, "sh")
    if not shutil.which("unshare") or subprocess.run([*prefix, "true"], capture_output=True).returncode:
        pytest.skip("hiding the headers needs the right to mount")
    with pytest.raises(
        RuntimeError, match=r"the\s+Python\s+headers\s+\(Debian:\s+apt\s+install\s+python3-dev\)"
    ):
        build(tmp_path / "wheel", prefix=prefix)


@pytest.mark.parametrize(
    "arguments",
    [("check", "cbha"), ("check", "finger", "--json"), ("ik", "cbha", "-"), ("fk", "trirack", "-"),
     ("run", "finger", "--mock"), ("run", "stiffflop2", "--mock", "--virtual")],
    ids=" ".join,
)  # fmt: skip
def test_a_command_without_kernels_is_one_located_error(without: Path, arguments: tuple[str, ...]) -> None:
    assert_one_located_error(command(without, *arguments), without, "--force-reinstall --no-deps contid'")


@pytest.mark.parametrize("name", ["finger", "cbha", "tendon3", "stiffflop1"])
def test_a_robot_in_python_without_kernels_is_the_same_error(without: Path, name: str) -> None:
    code = (
        "import sys, contid; from contid.errors import ContidError\n"
        "try: contid.Robot(sys.argv[1])\n"
        "except ContidError as error: print(error, file=sys.stderr); sys.exit(error.exit_code)"
    )
    assert_one_located_error(python(without, code, name), without, "apt install g++ python3-dev")


def test_in_a_checkout_the_remedy_is_its_own_installation(without: Path) -> None:
    shutil.copy(ROOT / "CMakeLists.txt", without)
    remedy = f"run '{sys.executable} -m pip install -e {without}', or start outside {without}"
    assert_one_located_error(command(without, "check", "cbha"), without, remedy)


def test_a_kernel_of_another_system_is_the_same_error(without: Path) -> None:
    """A file that the loader refuses, as one linked against a newer C library."""
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    for name in KERNELS:
        (without / "contid" / "kernels" / f"_{name}{suffix}").write_bytes(b"no library")
    done = command(without, "check", "cbha")
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert "contid's kernel 'arc' cannot be loaded (" in line
    assert "--force-reinstall" in line


def test_a_control_process_without_kernels_ends_the_run_with_that_error(tmp_path: Path) -> None:
    """The daemon has them, the process that it starts has not."""
    hidden = [f"contid.kernels._{name}{build}" for name in KERNELS for build in ("", "_avx2")]
    (tmp_path / "sitecustomize.py").write_text(
        "import sys\n"
        "if 'contid.control.process' in sys.orig_argv:\n"
        f"    sys.modules.update(dict.fromkeys({hidden}))\n"
    )
    done = subprocess.run(
        [sys.executable, "-m", "contid", "run", "cbha", "--mock"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        input="t_s,x_mm,y_mm,z_mm\n0,10,10,260\n",
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    (line,) = (line for line in done.stdout.splitlines() if "is not compiled: " in line)
    assert f"pip install -e {ROOT}" in line


def test_a_second_build_compiles_nothing_again(tmp_path: Path) -> None:
    """pip brings nanobind in a new folder at every build: commands and headers stay the same."""
    spec = find_spec("nanobind")
    assert spec is not None
    assert spec.origin is not None
    installed = Path(spec.origin).parent
    seen = []
    for name in ("first", "second"):
        package = tmp_path / name / "nanobind"
        shutil.copytree(installed, package, copy_function=shutil.copy)  # new times
        configure = ["cmake", "-S", str(ROOT), "-B", str(tmp_path / "build"), "-G", "Ninja"]
        given = (f"-DPython_EXECUTABLE={sys.executable}", "-DCMAKE_EXPORT_COMPILE_COMMANDS=ON")
        environment = {**os.environ, "PYTHONPATH": str(package.parent)}
        subprocess.run([*configure, *given], check=True, capture_output=True, env=environment)
        commands = (tmp_path / "build" / "compile_commands.json").read_text()
        headers = {path: path.stat().st_mtime_ns for path in (tmp_path / "build").rglob("nanobind/**/*.h")}
        assert len(headers) > 20
        assert str(tmp_path / name) not in commands
        seen.append((commands, headers))
        shutil.rmtree(package.parent)
    assert seen[0] == seen[1]
