"""Numbers in the docs: each section that has measured ones names the command that prints them.

A section does so by a command in its text or tables, or by a comment
`<!-- numbers by: COMMAND -->`; `<!-- numbers: SOURCE -->` is for those that nobody measured (given
by a scene, by the paper, or constants of a method). The others stand in verification.md, each
with the reason.
"""

import re
from pathlib import Path

import pytest

from doc_pages import UNPUBLISHED, page_named

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *(p for p in sorted(DOCS.rglob("*.md"))
                               if p.relative_to(DOCS).parts[0] not in UNPUBLISHED)]
LEFT_OUT = {"bibliography.md", "mistakes.md", "verification.md"} | (
    {p.name for p in (DOCS / "reference").glob("*.md")} - {"equations.md", "glossary.md"})
"""Generated from the code, but the first two."""
UNITS = "ms|us|s|GB|MB|K|%|times|µm|um|nm|mm"
NUMBER = re.compile(rf"(?<![\w.])(\d+(?:\.\d+)?e-?\d+|\d+(?:\.\d+)?\s?(?:{UNITS})\b)")
COMMAND = re.compile(
    r"sparsemor (?:run|compare|study|reproduce|stability|validate|plugins|export|pictures|schema)\b"
    r"|python tests/benchmarks/|pytest|tests/(?:benchmarks|physics|laws)/[\w/]+\.py"
    r"|```(?:console|python)|<!-- study |<!-- numbers by: |<!-- numbers: ")
WITHOUT = re.compile(r"<!-- numbers without a command: (.+?) -->")
BY = re.compile(r"<!-- numbers by: (.+?) -->")


def sections(page: Path) -> list[tuple[str, str]]:
    """(heading, text below it) of a page; the first has no heading."""
    # a line of code that begins with # is no heading
    text = re.sub(r"(?ms)^```.*?^```", lambda m: re.sub(r"(?m)^#", "'#", m[0]),
                  page.read_text(encoding="utf-8"))
    parts = re.split(r"(?m)^(#+ .*)$", text)
    return [("", parts[0]), *zip(parts[1::2], parts[2::2], strict=True)]


def measured(text: str) -> bool:
    return bool(NUMBER.search(re.sub(r"`[^`]*`", "", text)))


@pytest.mark.parametrize("page", [p for p in PAGES if p.name not in LEFT_OUT],
                         ids=lambda p: str(p.relative_to(ROOT)))
def test_measured_numbers_name_their_command(page: Path) -> None:
    silent = [heading for heading, text in sections(page)
              if measured(text) and not COMMAND.search(text) and not WITHOUT.search(text)]
    assert not silent, silent


def test_numbers_without_a_command_are_listed() -> None:
    listed = page_named("verification.md").read_text(encoding="utf-8")
    for page in PAGES:
        for reason in WITHOUT.findall(page.read_text(encoding="utf-8")):
            assert f"* {reason}\n" in listed, (page, reason)


def test_commands_name_what_exists() -> None:
    known = {p.stem for p in (ROOT / "plugins" / "studies").glob("*.yaml")}
    for page in PAGES:
        for command in (c for text in BY.findall(page.read_text(encoding="utf-8"))
                        for c in text.split(";")):
            words = command.split()
            files = [w for w in words if w.startswith("tests/")]
            assert all((ROOT / f).exists() for f in files), command
            if words[:2] == ["sparsemor", "study"] and not files:
                assert words[2] in known, command
