"""`studies.bench_ik` and `studies.train`: the table exists, is honest, and the network comes back."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from studies import bench_ik, comparison, shape_comparison
from studies.train import command as train_command


def kept(function):
    """What a function returned first, whatever it is asked later."""
    found: list[object] = []

    def call(*arguments):
        if not found:
            found.append(function(*arguments))
        return found[0]

    return call


@pytest.fixture(scope="module", autouse=True)
def computed_once():
    """Both forms of the output are of the same figures."""
    with pytest.MonkeyPatch.context() as patch:
        for module, name in (
            (comparison, "compare"), (comparison, "drift"), (shape_comparison, "compare_shapes"),
        ):  # fmt: skip
            patch.setattr(module, name, kept(getattr(module, name)))
        yield


@pytest.mark.slow
def test_train_then_compare(tmp_path):
    path = tmp_path / "net.npz"
    train = [str(path), "--hidden", "6", "--levels", "2", "--iterations", "40"]
    result = CliRunner().invoke(train_command, train, catch_exceptions=False)
    assert result.exit_code == 0
    assert "mean tip error" in result.stderr
    bench = ["--network", str(path), "--random", "1", "--json"]
    result = CliRunner().invoke(bench_ik.command, bench, catch_exceptions=False)
    assert result.exit_code == 0
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    rows = {line["name"]: line for line in lines if line["kind"] == "method"}
    newton = rows["Newton-Raphson (NumPy)"]
    assert newton["paper_us"] == 233500
    assert max(newton["max_mm"]) < 1e-3
    printed = rows["DLS as printed, lambda 0.5 (NumPy)"]
    assert [round(value, 2) for value in printed["max_mm"]] == [0.77, 2.25, 6.40]
    ours = next(row for name, row in rows.items() if name.startswith("contid"))
    assert max(ours["max_mm"]) < 1e-3
    assert any(name.startswith("neural network, 6") for name in rows)
    assert rows["hybrid: not reproducible from the text"]["max_mm"] is None
    drifts = [line for line in lines if line["kind"] == "drift" and line["point"] == 99]
    by_damping = {line["damping"]: line for line in drifts}
    # A smaller damping removes its own share and leaves the linearisation's; feedback leaves neither.
    assert by_damping[0.01]["from_damping_mm"] < 0.05
    assert by_damping[0.01]["from_linearisation_mm"] > 5.0
    assert by_damping[0.5]["with_feedback_mm"] < 0.2


@pytest.mark.slow
def test_the_table_is_marked_as_simulated():
    result = CliRunner().invoke(bench_ik.command, ["--no-network", "--random", "0"], catch_exceptions=False)
    assert result.exit_code == 0
    assert "simulated" in result.stdout
    assert "times as long" in result.stdout
