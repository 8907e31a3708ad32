"""The site of mkdocs.yml builds strictly; it has every page, every linked file and the public API."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

import pytest

import contid
import contid.hal

pytestmark = pytest.mark.process

ROOT = Path(__file__).parent.parent.parent


#: The site takes eight seconds to build. Links are checked in CI by test_links, names by test_library.
site_is_built = pytest.mark.campaign


def test_the_navigation_has_pages_of_docs_once_each() -> None:
    """The short form: by the file of the site, without building it."""
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:\n")[1]
    listed = re.findall(r"(?<=[ :])([\w/-]+\.md)$", navigation, re.MULTILINE)
    pages = {page.relative_to(ROOT / "docs").as_posix() for page in (ROOT / "docs").rglob("*.md")}
    assert set(listed) <= pages  # a hook appends the others
    assert len(listed) == len(set(listed))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for package in ("material", "mkdocstrings"):
        pytest.importorskip(package, reason="the site needs pip install 'contid[docs]'")
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", folder],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@site_is_built
def test_every_page_of_docs_is_in_the_navigation_of_the_first_page(site: Path) -> None:
    first = (site / "index.html").read_text(encoding="utf-8")
    linked = set(re.findall(r'href="([^"#]+)"[^>]*class="md-nav__link', first))
    names = (page.relative_to(ROOT / "docs") for page in (ROOT / "docs").rglob("*.md"))
    built = {f"{name.with_suffix('')}/".removesuffix("index/").removesuffix("README/") for name in names}
    missing = {name for name in built if name} - linked
    assert not missing


@site_is_built
def test_every_relative_link_of_the_built_pages_leads_to_a_file(site: Path) -> None:
    dead = []
    for page in site.rglob("*.html"):
        if page.name == "404.html":  # its links begin at the root of the host
            continue
        for link in re.findall(r'(?:href|src)="?([^"#\s>?]+)', page.read_text(encoding="utf-8")):
            if re.match(r"[a-z]+:|//", link):
                continue
            target = (page.parent / unquote(link)).resolve()
            if not (target / "index.html" if target.is_dir() else target).is_file():
                dead.append((str(page.relative_to(site)), link))
    assert not dead


@site_is_built
def test_the_api_page_has_every_public_name_and_method(site: Path) -> None:
    text = (site / "api" / "index.html").read_text(encoding="utf-8")
    anchors = set(re.findall(r'id="(contid\w*\.[\w.]+)"', text))
    for public in sorted(set(contid.__all__) - {"__version__"}):
        kind = getattr(contid, public)
        methods = {name for name in dir(kind) if not name.startswith("_") and callable(getattr(kind, name))}
        shown = (public, "Procedures", "BlockingProcedures") if public == "Client" else (public,)
        found = {each.rsplit(".", 1)[1] for each in anchors if each.split(".")[-2] in shown}
        assert methods <= found, public
    documented = [
        name
        for name in contid.hal.__all__
        if inspect.isroutine(each := getattr(contid.hal, name)) or inspect.isclass(each)
    ]
    assert len(documented) > 20
    assert {f"contid.hal.{name}" for name in documented} <= anchors


@site_is_built
def test_the_search_finds_pages_by_their_text(site: Path) -> None:
    index = (site / "search" / "search_index.json").read_text(encoding="utf-8")
    for text in ("axis-silent", "Troubleshooting by symptom", "bending_gain"):
        assert text in index
