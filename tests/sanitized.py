"""Tests of the kernels under sanitizers: ``python -m tests.sanitized [SANITIZERS] [PYTEST ARGUMENTS]``.

``address,undefined`` (the default) watches memory and arithmetic, ``thread`` the threads of batches. Builds
the kernels of this checkout into ``build/sanitized``, beside a copy of the package, and runs pytest there,
with the run-time libraries loaded first. A finding ends the run with its report. Needs g++ with libasan,
libubsan and libtsan; the first build takes some minutes of one core.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
#: By sanitizers: the libraries to load first, a symbol that shows that they are, and the tests.
KINDS: Final = {
    "address,undefined": (
        ("libasan.so", "libubsan.so"),
        "__asan_init",
        ["tests/kernels", "tests/kinematics/batch", "tests/clearance"],
    ),
    "thread": (("libtsan.so",), "__tsan_init", ["tests/kinematics/batch"]),
}
#: An editable install finds the package in this checkout by a finder of its own; the copy goes first.
START: Final = (
    "import sys; sys.meta_path[:] = [f for f in sys.meta_path if 'Redirecting' not in type(f).__name__]; "
    "sys.path[:0] = {paths!r}; import ctypes, contid.kernels, contid.kernels._arc as arc; "
    "assert arc.__file__.startswith({tree!r}), arc.__file__; getattr(ctypes.CDLL(None), {symbol!r}); "
    "import pytest; sys.exit(pytest.main(sys.argv[1:]))"
)
ENVIRONMENT: Final = {
    # The interpreter keeps memory until its end.
    "ASAN_OPTIONS": "detect_leaks=0:strict_init_order=1:abort_on_error=1",
    "UBSAN_OPTIONS": "print_stacktrace=1",
    "TSAN_OPTIONS": "halt_on_error=1:second_deadlock_stack=1",
    # Every allocation of Python is seen, not only those of its pools.
    "PYTHONMALLOC": "malloc",
    "PYTHONPATH": "",
    "OPENBLAS_NUM_THREADS": "1",
}


def build(sanitizers: str) -> Path:
    """The folder of a copy of the package with sanitized kernels."""
    folder = ROOT / "build" / "sanitized" / sanitizers.replace(",", "-")
    tree, objects = folder / "tree", folder / "objects"
    shutil.rmtree(tree, ignore_errors=True)
    for name in ("contid", "tests", "configs", "drivers", "firmware", "pyproject.toml"):
        source, target = ROOT / name, tree / name
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
        else:
            shutil.copy(source, target)
    commands = [
        ["-S", str(ROOT), "-B", str(objects), f"-DPython_EXECUTABLE={sys.executable}",
         "-DCMAKE_BUILD_TYPE=None", f"-DCONTID_SANITIZE={sanitizers}"],
        ["--build", str(objects), "--parallel", str(os.cpu_count() or 1)],
        ["--install", str(objects), "--prefix", str(tree), "--component", "kernels"],
    ]  # fmt: skip
    for arguments in commands:
        subprocess.run(["cmake", *arguments], check=True)
    return tree


def library(name: str) -> str:
    """Path of a run-time library of g++."""
    found = subprocess.run(["g++", f"-print-file-name={name}"], capture_output=True, text=True, check=True)
    path = found.stdout.strip()
    if not Path(path).is_file():
        raise SystemExit(f"{name} is not installed (Debian: it comes with g++)")
    return path


def main(arguments: list[str]) -> int:
    """Build, then run pytest; its exit code."""
    sanitizers = arguments.pop(0) if arguments and arguments[0] in KINDS else "address,undefined"
    libraries, symbol, tests = KINDS[sanitizers]
    preload = " ".join(map(library, libraries))
    tree = build(sanitizers)
    start = START.format(paths=[str(tree), str(tree / "drivers")], tree=str(tree), symbol=symbol)
    pytest = [sys.executable, "-c", start, "-q", "-p", "no:cacheprovider", "--capture=sys"]
    # ThreadSanitizer of g++ 12 fails where addresses have more than 28 random bits.
    fixed = ["setarch", platform.machine(), "-R"] if sanitizers == "thread" else []
    return subprocess.run(
        [*fixed, "env", f"LD_PRELOAD={preload}", *pytest, *(arguments or tests)],
        cwd=tree,
        env={**os.environ, **ENVIRONMENT},
    ).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
