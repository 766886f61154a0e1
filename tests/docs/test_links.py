"""Every link of the pages leads to a file or folder that exists, and to a heading that it has."""

import re
import runpy
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from doc_pages import UNPUBLISHED

ROOT = Path(__file__).parents[2]
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
_FENCE = re.compile(r"^ *```.*?^ *```[ \t]*$", re.MULTILINE | re.DOTALL)
_TOCTREE = re.compile(r"^```\{toctree\}\n((?::.*\n)*(?:.*\n)*?)```", re.MULTILINE)
_IMAGE = re.compile(r"!\[([^\]]*)\]\(([^)]+)\)")
_CODE = re.compile(r"`[^`\n]*`")
_LINK = re.compile(r"\[[^\[\]]*\]\(([^()\s]+)\)")
_HEADING = re.compile(r"^#{1,6} +(.*?) *#*$", re.MULTILINE)



def toctree(page: str) -> list[str]:
    """Names and patterns of the pages that a page lists in its toctrees."""
    return [line for block in _TOCTREE.findall(page) for line in block.split()
            if not line.startswith(":")]


def links(page: str) -> list[str]:
    """Targets of all links to files of this repository, in a page's text without its code."""
    text = _CODE.sub("code", _FENCE.sub("", page))
    return [t for t in _LINK.findall(text) if "://" not in t and not t.startswith("mailto:")]


def anchors(page: str) -> Iterator[str]:
    """Names of a page's headings, as GitHub makes them: the second of one name ends in -1."""
    seen: Counter[str] = Counter()
    for heading in _HEADING.findall(_FENCE.sub("", page)):
        shown = re.sub(r"\[([^\[\]]*)\]\([^()]*\)", r"\1", heading)
        name = re.sub(r"[^\w\- ]", "", shown.lower()).replace(" ", "-")
        yield f"{name}-{seen[name]}" if seen[name] else name
        seen[name] += 1


@cache
def anchors_of(path: Path) -> frozenset[str]:
    return frozenset(anchors(path.read_text(encoding="utf-8")))


def broken(path: Path, page: str) -> list[str]:
    """Those links of a page in the folder of `path` that lead nowhere."""
    found = []
    for target in links(page):
        name, _, anchor = target.partition("#")
        there = path.parent / name if name else path
        if not there.exists() or anchor and anchor not in anchors_of(there):
            found.append(target)
    return found


def test_links_lead_somewhere() -> None:
    found = {str(p.relative_to(ROOT)): broken(p, p.read_text(encoding="utf-8")) for p in PAGES}
    assert {page: targets for page, targets in found.items() if targets} == {}


def test_the_site_leads_to_every_page() -> None:
    docs = ROOT / "docs"
    named = {page for p in docs.rglob("*.md")
             for pattern in toctree(p.read_text(encoding="utf-8"))
             for page in p.parent.glob(pattern.replace("**", "**/*") + ".md")}
    pages = {p for p in docs.rglob("*.md") if p.relative_to(docs).parts[0] not in UNPUBLISHED}
    assert pages - named <= {docs / "index.md"}


def test_the_picture_of_the_data_flow_is_the_drawn_one() -> None:
    made = runpy.run_path(str(ROOT / "docs" / "make_data_flow.py"))
    assert made["drawing"]() == (ROOT / "docs" / "data-flow.svg").read_text(encoding="utf-8")


def test_every_picture_has_a_text_in_its_place() -> None:
    silent = [f"{p.name}: {src}" for p in PAGES for alt, src in _IMAGE.findall(
        p.read_text(encoding="utf-8")) if len(alt) < 15]
    silent += [p.name for p in PAGES
               for tag in re.findall(r"<img [^>]*>", p.read_text(encoding="utf-8"))
               if not re.search(r'alt="[^"]{10,}"', tag)]
    assert not silent


def test_a_wrong_link_is_found(tmp_path: Path) -> None:
    (tmp_path / "other.md").write_text("# Two `words`, so\n\n## Again\n\n## Again\n")
    page = ("# Here\n[a](other.md#two-words-so) [b](other.md#again-1) [c](#here) `[d](e)`\n"
            "[f](https://example.org/x) [g](none.md) [h](other.md#again-2) [i](#there)\n")
    here = tmp_path / "page.md"
    here.write_text(page)
    assert broken(here, page) == ["none.md", "other.md#again-2", "#there"]
