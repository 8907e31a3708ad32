"""`down`: files with the key `gravity`, or written for its default, are refused with the line to write."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from contid.cli.commands.check import command
from contid.errors import BadInputError
from contid.robot_file.load import LoadedFile, parse_robot_file

HANGING = "    base: {z_mm: 500, roll_deg: 180}\n"


def rod(configs: Path, base: str = "", gravity: str = "", beside: str = "") -> str:
    text = (configs / "tendon3.yaml").read_text(encoding="utf-8")
    text = text.replace("    model: tendon\n", f"    model: tendon\n{base}{beside}")
    return text.replace("    rates:\n", f"    rod: {{weight_n_per_m: [2.0]{gravity}}}\n    rates:\n", 1)


def pneumatic(configs: Path, beside: str = "", gravity: str = "", density: str = "1070") -> str:
    text = (configs / "stiffflop2.yaml").read_text(encoding="utf-8")
    text = text.replace("    down: [0, 0, 1]\n", beside)
    text = text.replace("    geometry:\n", f"    geometry:\n{gravity}", 1)
    return text.replace("link_mm: 5.0\n", f"link_mm: 5.0\n          density_kg_m3: {density}\n")


def down(loaded: LoadedFile) -> tuple[float, ...]:
    return loaded.file.robots["arm"].down_in_base


@pytest.mark.parametrize(
    ("base", "gravity", "remedy"),
    [
        (HANGING, "[0, 0, 1]", "remove this line: down is [0, 0, -1] already"),
        (HANGING, "[0, 0, -1]", "write down: [0, 0, 1] beside model"),
        ("", "[0, 0, 2]", "write down: [0, 0, 1] beside model"),
        ("    base: {pitch_deg: 90}\n", "[0, 0, -1]", "write down: [-1, 0, 0] beside model"),
        ("", "[0, 0, 0]", "write down: [x, y, z] beside model"),
        ("", "no", "write down: [x, y, z] beside model"),
    ],
)
def test_gravity_of_the_base_is_refused_where_it_stands(
    configs: Path, base: str, gravity: str, remedy: str
) -> None:
    text = rod(configs, base, f", gravity: {gravity}")
    with pytest.raises(BadInputError) as caught:
        parse_robot_file(text, "rod.yaml")
    rows = text.splitlines()
    line = next(n for n, row in enumerate(rows) if "gravity" in row)
    place = f"rod.yaml:{line + 1}:{rows[line].index('gravity') + 1}: key 'gravity'"
    assert str(caught.value).startswith(place)
    assert remedy in str(caught.value)
    assert len(caught.value.findings) == 1


def test_the_remedy_keeps_the_direction(configs: Path) -> None:
    """The recording of a file that is refused has the weight where the remedy puts it."""
    base = "    base: {roll_deg: 30, pitch_deg: 40, mirror_x: true}\n"
    text = rod(configs, base, ", gravity: [3, 0, -4]")
    recorded = parse_robot_file(text, "rod.yaml", recorded=True)
    assert down(recorded) == pytest.approx((0.6, 0.0, -0.8), abs=1e-6)
    with pytest.raises(BadInputError) as caught:
        parse_robot_file(text, "rod.yaml")
    written = str(caught.value).partition("write ")[2].partition(" beside")[0]
    corrected = parse_robot_file(rod(configs, base, beside=f"    {written}\n"), "rod.yaml")
    assert down(corrected) == pytest.approx((0.6, 0.0, -0.8), abs=1e-5)


def test_a_pneumatic_arm_with_weight_states_down(configs: Path) -> None:
    """Left out, its weight acted along +z of the base; now it would act along -z of the world."""
    with pytest.raises(BadInputError, match=r"gravity.*down: \[0, 0, -1\], or as before \[0, 0, 1\]"):
        parse_robot_file(pneumatic(configs), "arm.yaml")
    assert down(parse_robot_file(pneumatic(configs), "arm.yaml", recorded=True)) == (0.0, 0.0, 1.0)
    stated = parse_robot_file(pneumatic(configs, "    down: [0, 0, -3]\n"), "arm.yaml")
    assert down(stated) == (0.0, 0.0, -1.0)
    turned = parse_robot_file(pneumatic(configs, "    base: {roll_deg: 180}\n"), "arm.yaml")
    assert down(turned) == (0.0, 0.0, 1.0)
    parse_robot_file(pneumatic(configs, density="0"), "arm.yaml")


def test_recordings_of_the_old_key_are_read(configs: Path) -> None:
    text = pneumatic(configs, gravity="      gravity: [0, 2, 0]\n")
    text = text.replace("    placeholder:\n", "    placeholder:\n      - geometry.gravity\n")
    loaded = parse_robot_file(text, "arm.yaml", recorded=True)
    assert down(loaded) == (0.0, 1.0, 0.0)
    assert "down" in loaded.file.robots["arm"].placeholder


@pytest.mark.parametrize(
    ("base", "sense"), [("", "stands"), (HANGING, "hangs"), ("    base: {pitch_deg: 90}\n", "aslant")]
)
def test_check_prints_which_way_the_weight_acts(configs: Path, tmp_path: Path, base: str, sense: str) -> None:
    (tmp_path / "rod.yaml").write_text(rod(configs, base), encoding="utf-8")
    found = CliRunner().invoke(command, [str(tmp_path / "rod.yaml")])
    assert found.exit_code == 0
    line = next(row for row in found.output.splitlines() if "gravity" in row)
    assert sense in line
    assert "[0, 0, -1] of the world" in line


def test_robots_of_a_file_are_in_one_world(configs: Path) -> None:
    text = (configs / "chain.yaml").read_text(encoding="utf-8")
    models = text.count("    model: tri_tube\n")
    assert models == 2
    one = text.replace("    model: tri_tube\n", "    model: tri_tube\n    down: [0, 0, 1]\n", 1)
    with pytest.raises(BadInputError, match="one world"):
        parse_robot_file(one, "chain.yaml")
    both = text.replace("    model: tri_tube\n", "    model: tri_tube\n    down: [0, 0, 1]\n")
    with pytest.raises(BadInputError, match="a rope hangs along"):
        parse_robot_file(both, "chain.yaml")
