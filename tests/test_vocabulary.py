"""The vocabulary and the map that a machine can check: banned words, one class per name, sizes of folders."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
# Whole words, also as parts of names (`_told`, `told_rows`). docs/glossary.md has the terms to use instead.
BANNED = (
    *("words", "told", "tell", "tells", "say", "says", "said", "hear", "hears", "heard", "knows"),
    *("nobody", "no one", "whoever", "somebody", "someone", "shall", "believe", "believes", "believed"),
    *("desk", "patience", "course", "door", "house", "picture", "mend", "mended", "starved", "wanted", "aim"),
    *("tether", "farewell", "handbook", "nothing is made up"),
    *("so many", "knew", "asked for again", "goes nowhere", "way they came", "way they went", "forgets"),
)
BANNED_WORD = re.compile(rf"(?<![A-Za-z])(?<!of )({'|'.join(BANNED)})(?![A-Za-z])(?<!\.tell)", re.IGNORECASE)
SCANNED = (
    *("contid", "drivers", "extras", "studies", "firmware", "examples", "host", "configs", "docs"),
    "benchmarks",
)
SUFFIXES = frozenset({".py", ".cpp", ".hpp", ".h", ".ino", ".md", ".yaml", ".service", ".rules"})
# Lines that hold a banned word for a reason: keys of old recordings, a quotation, a word of another program.
QUOTATIONS = {"contid/session/format/channels.py": "RENAMED_EVENT_KEYS"}


def texts() -> Iterator[tuple[str, str]]:
    """Path relative to the repository, and text, of every scanned file that is no test."""
    pages = sorted(ROOT.glob("*.md"))
    for folder in SCANNED:
        found = (path for path in (ROOT / folder).rglob("*") if path.suffix in SUFFIXES)
        pages += sorted(path for path in found if not is_extras_test(path))
    for path in pages:
        yield path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")


def may_have_banned(text: str) -> bool:
    """False for most texts, ten times faster than the pattern; underscores part words."""
    text = text.lower().replace("_", " ")
    phrases = (each for each in BANNED if " " in each)
    return not set(re.findall("[a-z]+", text)).isdisjoint(BANNED) or any(each in text for each in phrases)


def is_extras_test(path: Path) -> bool:
    return path.relative_to(ROOT).match("extras/*/tests/*")


def python_files(*folders: str) -> Iterator[Path]:
    """Of folders, which may be patterns."""
    for folder in folders:
        yield from sorted(ROOT.glob(f"{folder}/**/*.py"))


def test_no_banned_word() -> None:
    found = [
        f"{path}:{number}: {match[0]!r} in {line.strip()}"
        for path, text in texts()
        if may_have_banned(text)
        for number, line in enumerate(text.splitlines(), start=1)
        for match in [BANNED_WORD.search(line)]
        if match and QUOTATIONS.get(path, "\0") not in line
    ]
    assert not found, "see docs/glossary.md\n" + "\n".join(found)


def test_no_banned_word_in_tests() -> None:
    """Names and text; tests of command lines and registers have words in the literal sense."""
    found = [
        f"{path.relative_to(ROOT).as_posix()}:{number}: {match[0]!r} in {line.strip()}"
        for path in python_files("tests", "extras/*/tests")
        if path != Path(__file__) and may_have_banned(text := path.read_text(encoding="utf-8"))
        for number, line in enumerate(text.splitlines(), start=1)
        for name in [re.search(r"\b(?:def|class) (\w+)", line)]
        for match in [BANNED_WORD.search(line), BANNED_WORD.search(name[1].replace("_", " ") if name else "")]
        if match and match[0].lower() != "words"
    ]
    assert not found, "see docs/glossary.md\n" + "\n".join(found)


def test_the_list_of_quotations_is_current() -> None:
    stale = [
        path for path, text in QUOTATIONS.items() if text not in (ROOT / path).read_text(encoding="utf-8")
    ]
    assert not stale


@pytest.mark.parametrize("text", ["def is_told():", "someone's arm", "What Nobody measured", "_words = 1"])
def test_the_pattern_finds_terms_and_parts_of_names(text: str) -> None:
    assert BANNED_WORD.search(text)
    assert may_have_banned(text)


@pytest.mark.parametrize("term", BANNED)
def test_no_term_is_missed_by_the_quick_look(term: str) -> None:
    assert may_have_banned(f"A_{term.replace(' ', '_')}.")
    assert may_have_banned(f"(It {term.upper()})")


@pytest.mark.parametrize("text", ["of course", "unknown", "essay", "housekeeping", "tellurium", "passwords"])
def test_the_pattern_leaves_other_text_alone(text: str) -> None:
    assert not BANNED_WORD.search(text)


# Classes whose name occurs twice, until one of them is renamed. The list only shrinks.
DOUBLE_CLASSES = frozenset[str]()
CLASS = re.compile(r"^ *class (\w+) *[:(\[]", re.MULTILINE)


def test_no_class_name_in_two_modules() -> None:
    modules = defaultdict(set)
    for path in python_files("contid", "drivers", "extras/*/contid_*", "studies"):
        for match in CLASS.finditer(path.read_text(encoding="utf-8")):
            modules[match[1]].add(path.relative_to(ROOT).as_posix())
    double = {name: sorted(paths) for name, paths in modules.items() if len(paths) > 1}
    assert double.keys() <= DOUBLE_CLASSES, double


def test_the_map_names_every_package() -> None:
    """CONTRIBUTING.md, by folder: packages of contid, of its models, of the drivers and of the extras."""
    folders = [
        path
        for top in ("contid", "contid/kinematics", "drivers/contid_drivers", "extras/*")
        for path in ROOT.glob(f"{top}/*")
    ]
    packages = {path.name for path in folders if path.is_dir() and (path / "__init__.py").is_file()}
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    missing = sorted(name for name in packages if not re.search(rf"\b{name}/", text))
    assert not missing, f"a row in the map of CONTRIBUTING.md for {missing}"


EXTRAS = "|".join(path.name for path in ROOT.glob("extras/*/contid_*"))
REFERENCE = re.compile(rf"`((?:contid|contid_drivers|{EXTRAS}|studies)(?:\.\w+)+)`")
# Names like modules: groups of entry points, and compiled kernels.
GROUPS = (
    "addresses|bodies|chains|checks|clearance|commands|contacts|drivers|emulators|exports|goals|library|models|"
    "modes|observers|recordings|solvers|stages|stretches|tools|workspaces"
)
NOT_MODULES = re.compile(rf"contid\.({GROUPS}|kernels\._\w+)")


def is_defined(reference: str) -> bool:
    """True when the module of a reference exists, and contains the name after it as a word."""
    names = reference.split(".")
    package = names[0].removeprefix("contid_")
    folder = ROOT / {"contid": "", "drivers": "drivers", "studies": ""}.get(package, f"extras/{package}")
    for count in range(len(names), 0, -1):
        base = folder / Path(*names[:count])
        for path in (base.with_suffix(".py"), base / "__init__.py"):
            if path.is_file():
                rest = names[count : count + 1]
                return not rest or bool(re.search(rf"\b{rest[0]}\b", path.read_text(encoding="utf-8")))
    return (folder / Path(*names)).is_dir()


def test_references_to_modules_exist() -> None:
    """In docstrings, comments and docs; a renamed class is renamed there too."""
    found = [
        f"{path}:{number}: {reference}"
        for path, text in texts()
        for number, line in enumerate(text.splitlines(), start=1)
        for reference in REFERENCE.findall(line)
        if not NOT_MODULES.fullmatch(reference) and not is_defined(reference)
    ]
    assert not found


MAX_FILES = 27
# Folders over the limit. The list only shrinks; decisions are numbered and stay, robot files have one folder.
LARGE_FOLDERS = frozenset({"configs", "docs/decisions"})


def test_no_folder_holds_more_than_27_files() -> None:
    counts: dict[str, int] = defaultdict(int)
    for folder in (*SCANNED, "tests"):
        for path in (ROOT / folder).rglob("*"):
            if path.is_file() and path.suffix not in {".pyc", ".so"}:
                counts[path.parent.relative_to(ROOT).as_posix()] += 1
    large = {folder: count for folder, count in counts.items() if count > MAX_FILES}
    assert large.keys() <= LARGE_FOLDERS, large


# Modules of tests that another test imports, until what they share moves. The list only shrinks.
IMPORTED_TESTS = frozenset[str]()
TEST_MODULE = re.compile(r"tests\.(?:\w+\.)*?test_\w+")


#: An import that may be of a test; only such files are parsed.
TEST_IMPORT = re.compile(r"^\s*from tests\S* import (?:\([^)]*|[^\n]*)", re.MULTILINE)


def imported_names(path: Path) -> Iterator[str]:
    text = path.read_text(encoding="utf-8")
    if not any("test_" in match[0] for match in TEST_IMPORT.finditer(text)) and "import tests" not in text:
        return
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{each.name}" for each in node.names)
        elif isinstance(node, ast.Import):
            yield from (each.name for each in node.names)


def test_no_test_imports_another_test() -> None:
    found = {
        match[0]
        for path in python_files("tests", "extras/*/tests")
        for name in imported_names(path)
        if (match := TEST_MODULE.match(name))
    }
    assert found <= IMPORTED_TESTS, sorted(found)


MAX_POSITIONAL = 6
#: Folders whose functions were checked; the others follow.
FEW_POSITIONAL = (
    *(
        "contid/api",
        "extras/clearance/contid_clearance",
        "contid/hal",
        "contid/robot_file",
        "contid/session",
        "contid/trajectory",
    ),
    "drivers",
)


def positional(node: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """Parameters that a call may give by their place, without those of a closure's constants."""
    given = [each.arg for each in (*node.args.posonlyargs, *node.args.args)]
    constants = {each.id for each in node.args.defaults if isinstance(each, ast.Name)}
    named = [name for name in given if name not in constants]
    return named[1:] if named[:1] in (["self"], ["cls"]) else named


def test_no_function_takes_more_than_six_positional_parameters() -> None:
    found = [
        f"{path.relative_to(ROOT).as_posix()}:{node.lineno}: {node.name}"
        for path in python_files(*FEW_POSITIONAL)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and len(positional(node)) > MAX_POSITIONAL
    ]
    assert not found, "make those from the seventh on keyword-only, or pass a record"


#: Stems of identifiers that had two meanings: the one that is left, the term of the other, and its
#: places in the folders that were checked. Keys of robot files keep their spelling (`friction.play_mm`).
HOMONYMS = {
    "play": ("run a trajectory; lost motion of a drive is backlash", {"contid/session", "play_mm"}),
    "home": (
        "find the zero of a device; a posture that redundancy prefers is a preferred posture",
        {"drivers", "contid/hal"},
    ),
}
TOKEN = re.compile(r"[A-Z]?[a-z]+")


def identifiers(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.arg(arg=name):
                yield name
            case ast.Name(id=name) | ast.Attribute(attr=name):
                yield name


@pytest.mark.parametrize("stem", HOMONYMS)
def test_a_stem_has_one_meaning(stem: str) -> None:
    meaning, places = HOMONYMS[stem]
    found = {
        f"{path.relative_to(ROOT).as_posix()}: {name}"
        for folder in FEW_POSITIONAL
        if folder not in places
        for path in python_files(folder)
        if stem in path.read_text(encoding="utf-8").lower()
        for name in identifiers(path)
        if name not in places and stem in {token.lower() for token in TOKEN.findall(name)}
    }
    assert not found, f"{stem}: {meaning}"
