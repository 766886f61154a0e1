"""Form of the pages: links to the glossary where a term is first used."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
GENERATED = {"contracts.md", "scene-reference.md"}
PAGES = [ROOT / "README.md", *(p for p in sorted(DOCS.rglob("*.md")) if p.name not in GENERATED)]
LINKED = [p for p in PAGES if p.parent in (DOCS, DOCS / "measured")
          and p.name not in ("glossary.md", "index.md", "bibliography.md", "paper_map.md",
                             "verification.md")]
"""Pages for readers; the others are lists."""
TERMS = {
    # term as a page writes it -> its row in the glossary
    r"atoms?": "atom",
    r"required rows": "required rows",
    r"training[ -]run": "training run",
    r"pre-simulation": "two stages, rigid-body pre-simulation",
    r"one-ring|the ring": "one-ring neighbourhood (`ring`)",
    r"warm-started": "warm-started support (`carried`)",
    r"preconditioned residual|D\^-1 r": "preconditioned residual",
    r"time-step map": "time-step map",
    r"modal coordinates": "modal coordinates",
    r"combined error": "combined error",
    r"local terms?": "local term",
    r"load tables?": "load table",
}
ANY = re.compile("|".join(rf"(?P<t{i}>(?<![\w-])(?:{t})(?![\w-]))" for i, t in enumerate(TERMS)),
                 re.IGNORECASE)


def without_code(page: str) -> str:
    """A page without code blocks and comments; what is left keeps its lines."""
    return re.sub(r"(?ms)^ *```.*?^ *```$|<!--.*?-->", lambda m: "\n" * m[0].count("\n"), page)


def prose(page: str) -> list[str]:
    """Lines that are neither code nor table, heading or picture."""
    return [line for line in without_code(page).splitlines()
            if not line.lstrip().startswith(("|", "#", "![", "<img")) and line[:4] != "    "]


def unlinked(page: str, glossary: str) -> list[str]:
    """Terms that the prose of a page uses before, or without, a link to the glossary."""
    seen, missing = set(), []
    text = re.sub(r"`[^`\n]*`", lambda m: "`" * len(m[0]), "\n".join(prose(page)))
    links = [m.span(1) for m in re.finditer(
        rf"\[([^\[\]]*)\]\([^()\s]*{glossary}\)", text)]
    others = [m.span() for m in re.finditer(r"\[[^\[\]]*\]\([^()\s]*\)", text)]
    for m in ANY.finditer(text):
        if m.lastgroup in seen or m.lastgroup is None:
            continue
        if any(a <= m.start() and m.end() <= b for a, b in links):
            seen.add(m.lastgroup)
        elif not any(a <= m.start() < b for a, b in others):  # inside another link: not the first
            seen.add(m.lastgroup)
            missing.append(m[0])
    return missing


def test_terms_of_the_glossary_exist() -> None:
    glossary = (DOCS / "glossary.md").read_text(encoding="utf-8")
    assert [row for row in TERMS.values() if f"\n| {row} |" not in glossary] == []


@pytest.mark.parametrize("path", LINKED, ids=lambda p: str(p.relative_to(ROOT)))
def test_the_first_use_of_a_term_is_a_link(path: Path) -> None:
    assert unlinked(path.read_text(encoding="utf-8"), "glossary.md") == []


def test_a_missing_link_is_found() -> None:
    page = "# Atoms\n\nAn `atom`, [atoms](../glossary.md), atoms; a training\nrun.\n"
    assert unlinked(page, "glossary.md") == []
    assert unlinked("An atom, [atoms](glossary.md).", "glossary.md") == ["atom"]
    assert unlinked("[an atom](other.md) and atoms", "glossary.md") == ["atoms"]
