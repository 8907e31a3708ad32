#!/bin/sh
# Compile the kernels into this checkout, so that it runs from PYTHONPATH without being installed.
# usage: tests/build_kernels.sh [PYTHON]
set -eu
cd "$(dirname "$0")/.."
python=${1:-python3}
cmake -S . -B build/kernels -DPython_EXECUTABLE="$(command -v "$python")" -DCMAKE_BUILD_TYPE=Release >/dev/null
cmake --build build/kernels
cmake --install build/kernels --prefix . --component kernels
