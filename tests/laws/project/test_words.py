"""Words of the field: banned words, openings of docstrings, one sentence for every plugin.

A ban holds in areas: docs (pages without their code), messages (strings in code that are no
docstrings), docstrings (those below attributes too, without what is in backticks), names (of
modules, classes and functions). The table `BANNED` switches areas on, word by word; `ALLOWED` has
the true uses that remain.
"""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

from source_trees import tree_of
from sparsemor.core.cli.plugins import first_sentence
from sparsemor.core.registry.registry import Registry

pytestmark = pytest.mark.full
ROOT = Path(__file__).parents[3]
CODE = ("core", "bodies", "integrators", "reducers", "plugins")
DOCS, MESSAGES, DOCSTRINGS, NAMES = "docs", "messages", "docstrings", "names"
EVERYWHERE = (DOCS, MESSAGES, DOCSTRINGS, NAMES)
TEXTS = (DOCS, MESSAGES, DOCSTRINGS)
BANNED = {
    # word or phrase: (instead, areas)
    "anew": ("again", TEXTS),
    "as it was left alone": ("an uninterrupted run", TEXTS),
    "at its largest": ("peak", TEXTS),
    "beside": ("next to", TEXTS),
    "besides": ("in addition", TEXTS),
    "beforehand": ("in advance", TEXTS),
    "by lot": ("at random", TEXTS),
    "comes out again": ("is reproduced", TEXTS),
    "feels": ("acts on", TEXTS),
    "felt": ("acts on", TEXTS),
    "feel": ("acts on", TEXTS),
    "foretell": ("estimate", TEXTS),
    "foretells": ("estimate", TEXTS),
    "foretold": ("estimated", TEXTS),
    "foreseen": ("predicted", TEXTS),
    "handed on": ("passed on", TEXTS),
    "hands": ("passes, returns", TEXTS),
    "handed": ("passed", TEXTS),
    "honest": ("consistent, correct", TEXTS),
    "in place of": ("instead of", TEXTS),
    "is asked": ("is evaluated", TEXTS),
    "is off by": ("has an error of", TEXTS),
    "left alone": ("uninterrupted", TEXTS),
    "made good": ("recovered", TEXTS),
    "made ready": ("prepared", TEXTS),
    "mend": ("fix", EVERYWHERE),
    "mended": ("fixed", TEXTS),
    "mends": ("fixes", TEXTS),
    "misfits": ("unmatched pattern", TEXTS),
    "ms a step": ("ms/step", TEXTS),
    "milliseconds a step": ("ms/step", TEXTS),
    "need no luck": ("are deterministic", TEXTS),
    "needs no luck": ("is deterministic", TEXTS),
    "natural modes": ("modal coordinates", TEXTS),
    "nobody": ("no part, no program", TEXTS),
    "on the way": ("during the run", TEXTS),
    "one-step map": ("time-step map", TEXTS),
    "put together": ("assembled", TEXTS),
    "quicker": ("faster", TEXTS),
    "reckoned": ("estimated", TEXTS),
    "charged": ("counted as excess growth", TEXTS),
    "softest": ("deflation space", TEXTS),
    "stands beside": ("is next to", TEXTS),
    "stands for": ("means", TEXTS),
    "stretches": ("column chunks", TEXTS),
    "told": ("reported, estimated", TEXTS),
    "tells": ("reports", TEXTS),
    "the error is theirs": ("is dominated by", TEXTS),
    "unmet": ("without contact", TEXTS),
    "unsaid": ("without a note", (MESSAGES, DOCSTRINGS)),
    "workshop": ("cache", EVERYWHERE),
    "wrong by its own size": ("a relative error of about 1", TEXTS),
    "wrong by their own size": ("a relative error of about 1", TEXTS),
    "twins": ("counterparts", TEXTS),
}
ALLOWED: set[tuple[str, str]] = set()
RIDDLE = re.compile(r"(What|Where|Which|How|Whether|Who|When)\b")


@dataclass(frozen=True, slots=True)
class Text:
    """Words of one area at one line of a file."""

    path: str
    line: int
    words: str


def prose(page: str) -> str:
    """A page without its code; lines keep their numbers."""
    return re.sub(r"(?ms)^```.*?^```|`[^`\n]*`", lambda m: "\n" * m[0].count("\n"), page)


def texts(area: str) -> Iterator[Text]:
    return _pages() if area == DOCS else _code(area)


def _pages() -> Iterator[Text]:
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        if page.name == "scene-reference.md":  # made of docstrings and options
            continue
        text, path = prose(page.read_text(encoding="utf-8")), str(page.relative_to(ROOT))
        for m in re.finditer(r"(?:[^\n]*\S[^\n]*\n?)+", text):  # a phrase may cross lines
            yield Text(path, text.count("\n", 0, m.start()) + 1, " ".join(m[0].split()))


def _code(area: str) -> Iterator[Text]:
    for path, tree in sources().items():
        yield from of_source(tree, path, area)


@cache
def sources() -> dict[str, ast.Module]:
    """Relative path -> the parsed file."""
    files = sorted(p for folder in CODE for p in (ROOT / folder).rglob("*.py"))
    return {str(p.relative_to(ROOT)): tree_of(p) for p in files}


def of_source(tree: ast.Module, path: str, area: str) -> Iterator[Text]:
    documented = [n for n in ast.walk(tree)
                  if isinstance(n, ast.Module | ast.ClassDef | ast.FunctionDef)]
    if area == NAMES:
        yield Text(path, 1, Path(path).stem.replace("_", " "))
        yield from (Text(path, n.lineno, _parts(n.name)) for n in documented
                    if not isinstance(n, ast.Module))
    else:
        loose = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}
        for n in ast.walk(tree):
            if not (isinstance(n, ast.Constant) and isinstance(n.value, str)):
                continue
            docstring = id(n) in loose
            if docstring == (area == DOCSTRINGS) and " " in n.value:  # sentences, not keys
                plain = re.sub(r"`[^`]*`", "", n.value)
                yield Text(path, n.lineno, " ".join(plain.split()))


def _parts(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).replace("_", " ").lower()


@cache
def uses(area: str) -> dict[tuple[str, str], str]:
    """(path, word) of the words that are banned in this area -> the last line with it."""
    banned = (w for w, (_, areas) in BANNED.items() if area in areas)
    words = "|".join(map(re.escape, sorted(banned, key=len, reverse=True)))
    found = re.compile(rf"(?<![\w.-])({words})(?![\w-])", re.IGNORECASE)
    return {(t.path, m[1].lower()): f"line {t.line}: {t.words[max(0, m.start() - 60):m.end() + 60]}"
            for t in texts(area) for m in found.finditer(t.words)}


@pytest.mark.parametrize("area", EVERYWHERE)
def test_no_banned_word(area: str) -> None:
    left = [f"{path}, {line}: write {BANNED[word][0]!r} instead of {word!r}"
            for (path, word), line in uses(area).items() if (path, word) not in ALLOWED]
    assert not left, "\n".join(left)


def test_allowed_uses_are_uses() -> None:
    assert {use for area in EVERYWHERE for use in uses(area)} >= ALLOWED


def test_a_banned_word_is_found_in_each_area() -> None:
    source = 'class ToldOff:\n    """Told."""\n    x = "it was told here"\n'
    found = {area: [t.words for t in of_source(ast.parse(source), "a/b_told.py", area)]
             for area in (MESSAGES, DOCSTRINGS, NAMES)}
    assert found == {MESSAGES: ["it was told here"], DOCSTRINGS: [],
                     NAMES: ["b told", "told off"]}
    assert prose("a\n```\ntold\n```\n`told` b") == "a\n\n\n\n b"


def test_no_docstring_opens_with_a_riddle() -> None:
    riddles = [f"{path}: {getattr(n, 'name', 'module')}"
               for path, tree in sources().items() for n in ast.walk(tree)
               if isinstance(n, ast.Module | ast.ClassDef | ast.FunctionDef)
               and RIDDLE.match(ast.get_docstring(n) or "")]
    assert not riddles, "say what the thing is: " + "\n".join(riddles)


def plugin_classes() -> list[tuple[str, type]]:
    registry = Registry()
    return [(f"{p.kind} {p.name}", registry.get(p.kind, registry.spelling(p)))
            for kind in registry.kinds() if kind not in ("scene", "study", "paper")
            for p in registry.names(kind) if p.distribution == "sparsemor"]


def test_every_plugin_is_one_sentence() -> None:
    """It begins with the method's name, not with a formula, and fits in two lines of a table."""
    found = {name: first_sentence(cls.__doc__ or "") for name, cls in plugin_classes()}
    assert len(found) > 60
    odd = {name: text for name, text in found.items()
           if not re.match(r"[A-Z][A-Za-z-]{2,}|[A-Z]-[a-z]|No ", text) or not text.endswith(".")
           or not 20 <= len(text) <= 180}
    assert not odd
