"""Robot files: mistakes, their places, and that all of them are reported together."""

from __future__ import annotations

import re
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from contid.errors import BadInputError, ContidError, Located
from contid.hal import DeviceKind, load_driver
from contid.robot_file import model_plugins
from contid.robot_file.load import find_robot_file, load_robot_file, parse_robot_file, with_mock


def findings(text: str) -> list[Located]:
    with pytest.raises(BadInputError) as caught:
        parse_robot_file(text, "robot.yaml")
    return list(caught.value.findings)


@pytest.fixture
def finger(configs: Path) -> str:
    return (configs / "finger.yaml").read_text()


@pytest.mark.parametrize("name", ["finger", "hand"])
def test_shipped_files_load_and_keep_their_text(configs: Path, name: str) -> None:
    loaded = load_robot_file(configs / f"{name}.yaml")
    assert loaded.text == (configs / f"{name}.yaml").read_text()
    assert loaded.file.name == name
    for bus in loaded.buses.values():
        assert {axis for axis, _ in bus.axes} == {
            f"{robot}.{axis}" for robot, each in loaded.file.robots.items() for axis in each.axes
        }


def test_the_mock_has_the_same_axes_on_simulated_devices(configs: Path) -> None:
    loaded = load_robot_file(configs / "hand.yaml")
    mock = with_mock(loaded)
    sim = load_driver("sim")
    for name, bus in mock.buses.items():
        assert bus.driver == "sim"
        assert [axis for axis, _ in bus.axes] == [axis for axis, _ in loaded.buses[name].axes]
        assert {sim.kind(options) for _, options in bus.axes} == {DeviceKind.SERVO}
    assert with_mock(mock).buses == mock.buses


# One mistake each: what is written, what it becomes, where the finding points, the message.
MISTAKES = [
    ("name: finger", "nam: finger", "nam:", "did you mean 'name'?"),
    ("rate_hz: 200", "rate_hz: -5", "-5", "greater than 0"),
    ("driver: dynamixel", "driver: dynamixl", "dynamixl", "did you mean 'dynamixel'?"),
    ("baud: 1000000", "baud: 1000001", "1000001", "allowed: 9600"),
    ("model: rack_finger", "model: rack_fingr", "rack_fingr", "did you mean 'rack_finger'?"),
    ("tip_length_mm: 22", "tip_lenght_mm: 22", "tip_lenght_mm", "did you mean 'tip_length_mm'?"),
    ("length_mm: [0, 100]", "length_mm: [100, 0]", "[100, 0]", "less than the second"),
    ("a_per_mm: 0.0013", "a_per_mm: small", "small", "allowed is a number"),
    ("b: -0.2774", "b: .inf", ".inf", "finite"),
    ("b: -0.2774", "b: -1.2774", "a_per_mm", "1 + a S + b is -0.2774 at S = 0 mm"),
    ("    correction:", "    base: {pitch_deg: 60}\n    correction:", "pitch_deg:", "out of the plane"),
    ("on_end: hold", "on_end: rset", "rset", "did you mean 'rest'?"),
    ("estop: relax", "estop: vent", "vent", "none"),
    ("rest_mm: [60, 60]", "rest_mm: [60, 160]", "160", "outside its limits 0 to 100 mm"),
    ("rest_mm: [60, 60]", "rest_mm: [60]", "[60]", "1 numbers; allowed: 2"),
    ("jerk_mm_s3: 20000", "jerk_mm_s3: true", "true", "allowed is a number"),
    ("      jerk_mm_s3: 20000\n", "", "rates:", "'jerk_mm_s3' is missing"),
    ("      jerk_mm_s3: 20000\n", "      jerk_bar_s3: 2\n", "rates:\n", "'jerk_mm_s3' is missing"),
    ("right: {bus: servos, id: 2,", "right: {bus: servos, id: 1,", "1, mm", "belongs to finger.left"),
    ("right: {bus: servos, id: 2,", "right: {bus: servo, id: 2,", "servo,", "did you mean 'servos'?"),
    ("right: {bus: servos, id: 2,", "right: {bus: servos, id: 300,", "300", "at most 252"),
    ("right: {bus: servos, id: 2,", "right: {bus: servos, idd: 2,", "idd", "did you mean 'id'?"),
    ("right: {bus: servos, id: 2,", "rigth: {bus: servos, id: 2,", "rigth", "did you mean 'right'?"),
    ("id: 2, mm_per_rev: 37.69911184307752", "id: 2", "right: {", "mm_per_rev is missing"),
    ("id: 2, mm_per_rev: 37.69911184307752", "id: 2, mm_per_rev: 0", "0}", "at least 0.1"),
    ("- rest_mm", "- resst_mm", "resst_mm", "names no key"),
    ("contid: 1", "contid: 2", "2", "allowed: 1"),
    ("gap_mm: 5", "gap_mm: 5, gap_mm: 6", "gap_mm: 6", "already on line"),
    ("rate_hz: 200", "rate_hz: *r", "*r", "repeats nothing"),
    ("rate_hz: 200", "rate_hz: !!python/name:os.system 200", "!!python", "tags"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "at", "expected"), MISTAKES, ids=[new.strip() or old for old, new, *_ in MISTAKES]
)
def test_a_mistake_is_found_where_it_stands(finger: str, old: str, new: str, at: str, expected: str) -> None:
    text = finger.replace(old, new, 1)
    assert text != finger
    found = findings(text)
    begin = text.index(new) if new else 0
    after = text.find(at, begin)
    before = text[: after if after >= 0 else text.rindex(at, 0, begin)]
    place = (before.count("\n") + 1, len(before) - before.rfind("\n"))
    assert any((each.line, each.column) == place and expected in each.message for each in found), found


def test_twelve_different_mistakes_are_twelve_findings_in_the_order_of_the_file(finger: str) -> None:
    edits = [
        ("rate_hz: 200", "rate_hz: fast"),
        ("baud: 1000000", "baudrate: 1000000"),
        ("tip_length_mm: 22", "tip_length_mm: -22"),
        ("gap_mm: 5}", "gap_mm: 5, pitch_mm: 3}"),
        ("length_mm: [0, 100]", "length_mm: [100, 0]"),
        ("      b: -0.2774\n", ""),
        ("velocity_mm_s: 60", "velocity_mm: 60"),
        ("rest_mm: [60, 60]", "rest_mm: [60, 60, 60]"),
        ("on_fault: hold", "on_fault: rest"),
        ("estop: relax", "estop: vent"),
        ("left: {bus: servos, id: 1", "left: {bus: servo, id: 1"),
        ("right: {bus: servos, id: 2, mm_per_rev: 37.69911184307752}", "right: {bus: servos, id: 2}"),
    ]
    text = finger
    for old, new in edits:
        assert old in text
        text = text.replace(old, new, 1)
    found = findings(text)
    # The misspelt velocity is two findings: the key that is unknown and the one that is missing.
    lines = {each.line for each in found}
    assert len(found) == 13, "\n".join(map(str, found))
    assert len(lines) >= 11
    assert [(each.line, each.column) for each in found] == sorted((each.line, each.column) for each in found)


def test_one_mistake_hides_no_other(finger: str) -> None:
    text = finger.replace("rack_spacing_mm: 13", "rack_spacing_mm: wide").replace(
        "rest_mm: [60, 60]", "rest_mm: [60]"
    )
    assert len(findings(text)) == 2


@pytest.mark.parametrize(
    ("change", "remedy"),
    [
        (("      tip_length_mm", "\ttip_length_mm"), "indent with spaces"),
        (("      tip_length_mm", "     tip_length_mm"), "indent this line as its neighbours, by spaces"),
        (("name: finger", "name: my: finger"), "quote a value that has a colon"),
    ],
)
def test_text_that_is_not_yaml_has_a_remedy(finger: str, change: tuple[str, str], remedy: str) -> None:
    (found,) = findings(finger.replace(*change))
    assert found.message.startswith("not YAML: ")
    assert remedy in found.message


def test_the_names_of_shipped_files_are_listed_once() -> None:
    with pytest.raises(ContidError) as refused:
        find_robot_file("hnd")
    assert ".emulated" not in str(refused.value)
    assert str(refused.value).endswith("did you mean 'hand'?")
    with pytest.raises(ContidError, match=r"did you mean 'hand\.emulated'"):
        find_robot_file("hnd.emulated")


def test_what_is_no_robot_file_is_refused() -> None:
    assert "mapping" in findings("- 1\n")[0].message
    assert "not YAML" in findings("a: [1, 2\nb: }")[0].message
    assert "deeper" in findings("a: " + "[" * 2000)[0].message
    assert "characters" in findings("a" * 1_000_001)[0].message
    assert "second document" in findings("contid: 1\n---\ncontid: 1\n")[0].message
    missing = {each.message.split("'")[1] for each in findings("{}")}
    assert missing == {"contid", "name", "rate_hz", "buses", "robots"}


def test_a_file_that_cannot_be_read_is_an_error_with_its_path(tmp_path: Path) -> None:
    with pytest.raises(ContidError, match="cannot read"):
        load_robot_file(tmp_path / "none.yaml")
    (tmp_path / "latin.yaml").write_bytes(b"name: \xe9")
    with pytest.raises(BadInputError, match=r"latin.yaml:1:7: byte 0xe9 is not UTF-8"):
        load_robot_file(tmp_path / "latin.yaml")


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ("rack_spacing_mm: 13", "rack_spacing_mm: 0.013", "at least 0.1, not 0.013"),
        ("length_mm: [0, 100]", "length_mm: [-50, 100]", "a length is not negative"),
        ("velocity_mm_s: 60", "velocity_mm_s: 1e300", "at most 1e+12"),
        ("jerk_mm_s3: 20000", "jerk_mm_s3: 1e-300", "at least 0.001"),
        ("name: finger", 'name: "a\\e[2J"', "name"),
        ("rate_hz: 200", "rate_hz: 15", "is too slow for the watchdog of bus 'servos' (watchdog_ms 100)"),
    ],
)
def test_what_could_not_be_a_robot_is_refused(before: str, after: str, expected: str, finger: str) -> None:
    assert before in finger
    found = findings(finger.replace(before, after, 1))
    assert [expected in each.message for each in found] == [True]


@pytest.mark.parametrize(
    ("config", "before", "after", "expected"),
    [
        ("trirack2", "[10, 10, 10,", "[10, .nan, 10,", "rest_mm: item 2: allowed is a finite number"),
        ("trirack2", "[10, 10, 10,", "[.inf, 10, 10,", "rest_mm: item 1: allowed is a finite number"),
        (
            "chain",
            "[110.417, 0.25]",
            "[110.417, .nan]",
            "mm_to_bar: row 2, item 2: allowed is a finite number",
        ),
        ("chain", "[110.417, 0.25]", "[110.417]", "mm_to_bar: row 2, item 2 is missing"),
        ("chain", "[10, 1.5]", "[5, 1.5]", "mm_to_bar covers 0 to 5 mm, the axis goes from 0 to 10 mm"),
        ("chain", ", [10, 1.5]", "", "mm_to_bar: at least two rows"),
        ("chain", "[10, 1.5]", "[10, 0]", "mm_to_bar: pressures must always rise or always fall"),
        ("chain", "[10, 1.5]", "[0, 1], [10, 1.5]", "mm_to_bar: lengths must increase"),
        ("chain", "mm_to_bar: [[0,", "mm_per_rev: 4, mm_to_bar: [[0,", "mm_per_rev has no meaning for a"),
    ],
)
def test_a_wrong_number_of_a_list_is_named_and_blames_nothing_else(
    config: str, before: str, after: str, expected: str, configs: Path
) -> None:
    text = (configs / f"{config}.yaml").read_text(encoding="utf-8")
    line = text[: text.index(before)].count("\n") + 1
    (found,) = findings(text.replace(before, after, 1))
    assert found.message.startswith(expected)
    assert found.line == line


def test_an_alias_repeats_a_value_and_keeps_its_place(finger: str) -> None:
    text = finger.replace(
        "{bus: servos, id: 1, mm_per_rev: 37.69911184307752}", "{bus: servos, id: 1, mm_per_rev: &p -3}"
    )
    text = text.replace("id: 2, mm_per_rev: 37.69911184307752", "id: 2, mm_per_rev: *p")
    found = findings(text)
    assert ["at least 0.1, not -3" in each.message for each in found] == [True, True]
    good = parse_robot_file(text.replace("&p -3", "&p 37.5"), "robot.yaml")
    assert [axis.mm_per_rev for axis in good.file.robots["finger"].axes.values()] == [37.5, 37.5]


def test_aliases_cannot_eat_the_machine() -> None:
    bomb = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
    for level in range(1, 12):
        bomb += f"a{level}: &a{level} [{', '.join([f'*a{level - 1}'] * 10)}]\n"
    assert "aliases written out" in findings(bomb)[0].message
    assert "repeats nothing" in findings("a: &x [*x]\n")[0].message


def test_a_robot_file_is_found_without_its_suffix(
    tmp_path: Path, configs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_robot_file("finger") == configs / "finger.yaml"
    Path("mine.yml").write_text("")
    assert find_robot_file("mine") == Path("mine.yml")
    # Two files of one name: which one is meant moves a robot.
    Path("finger.yaml").write_text("")
    with pytest.raises(ContidError, match=r"finger: could be one of finger\.yaml, .*configs/finger\.yaml"):
        find_robot_file("finger")
    assert find_robot_file("finger.yaml") == Path("finger.yaml")


@pytest.mark.parametrize("body", ["raise OSError('no licence')", "def", "PLUGIN = 1 / 0", "x = 1"])
def test_a_model_whose_import_fails_is_a_finding(
    body: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = "broken_" + "".join(filter(str.isalnum, body))
    (tmp_path / f"{module}.py").write_text(body + "\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    point = EntryPoint("broken", f"{module}:PLUGIN", model_plugins.ENTRY_POINT_GROUP)
    monkeypatch.setattr(model_plugins, "entry_points", lambda **_: [point])
    with pytest.raises(
        BadInputError, match=r"a\.yaml:\d+:\d+: model 'broken' .* cannot be imported: \w+Error: "
    ):
        parse_robot_file(
            "contid: 1\nname: a\nrate_hz: 100\nbuses: {b: {driver: sim}}\nrobots: {r: {model: broken}}\n",
            "a.yaml",
        )


@pytest.mark.parametrize(
    ("key", "allowed"),
    [
        ("on_end", "hold, rest, relax"), ("on_fault", "hold, relax"), ("on_host_loss", "hold, relax"),
        ("estop", "relax"),
    ],
)  # fmt: skip
def test_a_vent_without_regulators_names_what_is_allowed_in_its_place(
    key: str, allowed: str, finger: str
) -> None:
    text = re.sub(rf"(  {key}: )\w+", r"\1vent", finger)
    (found,) = findings(text)
    assert found.message.endswith(
        f"{key}: vent is for pressure regulators and this robot has none; allowed: {allowed}"
    )


def test_a_name_that_no_file_can_have_is_refused() -> None:
    with pytest.raises(ContidError, match="cannot read it: File name too long"):
        find_robot_file("a" * 300)
