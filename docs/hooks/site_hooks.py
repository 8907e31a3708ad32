"""Hooks of mkdocs.yml: complete navigation, lists as on GitHub, pages for linked files outside docs/."""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files, InclusionLevel

ROOT = Path(__file__).parent.parent.parent
#: Where files of the repository that pages link to are on the site.
OUTSIDE = "repository"
LINK = re.compile(r"(?<=\]\()([^)\s#]+)")
LISTED = {"decisions": "Decisions", "faults": "Faults"}
#: Binary or long files are copied as they are.
COPIED = {".ipynb", ".png", ".svg", ".gif"}


def on_config(config: Any) -> Any:
    """Append the folders of numbered pages, and the pages that mkdocs.yml does not list."""
    docs = Path(config.docs_dir)
    listed = set(re.findall(r"[\w-]+\.md", repr(config.nav)))
    more = [page.name for page in sorted(docs.glob("*.md")) if page.name not in {*listed, "faults.md"}]
    if more:
        config.nav.append({"More": more})
    config.nav.append({"Faults": ["faults.md", *pages(docs, "faults")]})
    config.nav.append({"Decisions": ["decisions/README.md", *pages(docs, "decisions")]})
    return config


def pages(docs: Path, folder: str) -> list[str]:
    """The numbered pages of a folder."""
    return [f"{folder}/{page.name}" for page in sorted((docs / folder).glob("[0-9]*.md"))]


def on_files(files: Files, config: Any) -> Files:
    """Give a page to every file outside docs/ that a page links to, and to those that these link to."""
    waiting = [(f"docs/{file.src_uri}", file.content_string) for file in files.documentation_pages()]
    done: set[str] = set()
    while waiting:
        path, text = waiting.pop()
        for target in LINK.findall(prose(text)):
            found = in_repository(path, target)
            if found is None or found in done:
                continue
            done.add(found)
            files.append(outside(found, config))
            if found.endswith(".md"):
                waiting.append((found, (ROOT / found).read_text(encoding="utf-8")))
    return files


def outside(path: str, config: Any) -> File:
    """The file of the site for a path of the repository outside docs/."""
    here = ROOT / path
    if here.suffix in COPIED:
        return File.generated(config, f"{OUTSIDE}/{path}", abs_src_path=str(here))
    if here.is_dir():
        names = "\n".join(f"* `{each.name}`" for each in sorted(here.iterdir()) if shown(each))
        text = f"# {path}\nA folder of the repository.\n\n{names}\n"
    elif here.suffix == ".md":
        text = here.read_text(encoding="utf-8")
        return File.generated(config, page_of(path), content=text, inclusion=InclusionLevel.NOT_IN_NAV)
    else:
        text = f"# {path}\n\n````{here.suffix[1:]}\n{here.read_text(encoding='utf-8')}\n````\n"
    text = f"---\nsearch:\n  exclude: true\n---\n{text}"
    return File.generated(config, page_of(path), content=text, inclusion=InclusionLevel.NOT_IN_NAV)


def shown(path: Path) -> bool:
    """Whether a file of a folder is one of the repository: no caches."""
    return not path.name.startswith((".", "__pycache__")) and path.suffix != ".egg-info"


def page_of(path: str) -> str:
    """The source name of the page that shows a path of the repository."""
    if Path(path).suffix in COPIED:
        return f"{OUTSIDE}/{path}"
    return f"{OUTSIDE}/{path}" if path.endswith(".md") else f"{OUTSIDE}/{path}.md"


def in_repository(page: str, target: str) -> str | None:
    """The path that a link leads to if it exists outside docs/; else None, and mkdocs checks the link."""
    if re.match(r"[a-z]+:", target):
        return None
    path = posixpath.normpath(posixpath.join(posixpath.dirname(page), target))
    if path.startswith(("docs/", "..")) or path == "docs" or not (ROOT / path).exists():
        return None
    return path


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Lead links to the pages above, and let a list begin without an empty line, as on GitHub."""
    uri = page.file.src_uri
    here = uri.removeprefix(f"{OUTSIDE}/") if uri.startswith(f"{OUTSIDE}/") else f"docs/{uri}"

    def lead(match: re.Match[str]) -> str:
        path = in_repository(here, match[1])
        if path is not None:
            return posixpath.relpath(page_of(path), posixpath.dirname(uri) or ".")
        if uri.startswith(f"{OUTSIDE}/") and not re.match(r"[a-z]+:", match[1]):
            inside = posixpath.normpath(posixpath.join(posixpath.dirname(here), match[1]))
            if inside == "docs":
                inside = "docs/index.md"
            if inside.startswith("docs/"):
                return posixpath.relpath(inside.removeprefix("docs/"), posixpath.dirname(uri))
        return match[1]

    parts = re.split(r"(^```.*?^```[^\n]*$)", markdown, flags=re.MULTILINE | re.DOTALL)
    parts[::2] = [spaced(LINK.sub(lead, part)) for part in parts[::2]]
    return "".join(parts)


def on_page_content(html: str, page: Any, config: Any, files: Files) -> str:
    """Show the versions of names that came after the first release."""
    return re.sub(r"<p>\.\. versionadded:: ([\d.]+)</p>", r"<p><em>From version \1 on.</em></p>", html)


def prose(text: str) -> str:
    """Text without its blocks of code."""
    return re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)


def spaced(text: str) -> str:
    """The text with an empty line before each list that follows a paragraph directly."""
    item = r"(?:[*-]|\d+\.) "
    return re.sub(rf"^(?!{item}|\s|$)(.+)\n(?={item})", r"\1\n\n", text, flags=re.MULTILINE)
