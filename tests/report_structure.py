"""Report on the structure of the repository: it prints, and never fails.

    python tests/report_structure.py            sizes
    python tests/report_structure.py --words    and each line with a word that the glossary replaces

Lines of code are those that are left without docstrings, comments and blank lines.
"""

import argparse
import ast
import io
import re
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PRODUCT = ("core", "bodies", "integrators", "reducers", "plugins")
BENCHMARKS = "tests/benchmarks"
"""Scripts that measure; counted apart from tests."""
LONG_FILE, MANY_FILES, LONG_PAGE = 400, 25, 1500
"""Sizes above which a file, a folder and a page are named (lines, files, words)."""
INSTEAD = {
    "anew": "again",
    "as it was left alone": "an uninterrupted run",
    "at its largest": "peak",
    "beside": "next to",
    "besides": "in addition",
    "beforehand": "in advance",
    "by lot": "at random",
    "comes out again": "is reproduced",
    "feels": "acts on",
    "felt": "acts on",
    "feel": "acts on",
    "foretell": "estimate",
    "foretells": "estimate",
    "foretold": "estimated",
    "foreseen": "predicted",
    "handed on": "passed on",
    "hands": "passes, returns",
    "handed": "passed",
    "honest": "consistent, correct",
    "in place of": "instead of",
    "is asked": "is evaluated",
    "is off by": "has an error of",
    "left alone": "uninterrupted",
    "made good": "recovered",
    "made ready": "prepared",
    "mend": "fix",
    "mended": "fixed",
    "mends": "fixes",
    "misfits": "unmatched pattern",
    "ms a step": "ms/step",
    "milliseconds a step": "ms/step",
    "need no luck": "are deterministic",
    "needs no luck": "is deterministic",
    "natural modes": "modal coordinates",
    "nobody": "no part, no program",
    "on the way": "during the run",
    "one-step map": "time-step map",
    "put together": "assembled",
    "quicker": "faster",
    "reckoned": "estimated",
    "charged": "counted as excess growth",
    "softest": "deflation space",
    "stands beside": "is next to",
    "stands for": "means",
    "stretches": "column chunks",
    "told": "reported, estimated",
    "tells": "reports",
    "the error is theirs": "is dominated by",
    "unmet": "without contact",
    "unsaid": "without a note",
    "workshop": "cache",
    "wrong by its own size": "a relative error of about 1",
    "wrong by their own size": "a relative error of about 1",
    "twins": "counterparts",
}
"""Words of private jargon, and the words of the field."""


def docstrings(tree: ast.Module) -> Iterator[ast.Constant]:
    """String constants that stand as statements, those below attributes included."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(
                node.value.value, str):
            yield node.value


def code_lines(text: str, tree: ast.Module) -> int:
    """Lines with at least one token that is no comment, less those of docstrings."""
    skipped = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
               tokenize.ENDMARKER}
    used = {line for token in tokenize.generate_tokens(io.StringIO(text).readline)
            if token.type not in skipped for line in range(token.start[0], token.end[0] + 1)}
    return len(used - {line for s in docstrings(tree)
                       for line in range(s.lineno, (s.end_lineno or s.lineno) + 1)})


def prose(page: str) -> str:
    """A page without its code; lines keep their numbers."""
    return re.sub(r"(?ms)^ *```.*?^ *```$|`[^`\n]*`", lambda m: "\n" * m[0].count("\n"), page)


def texts() -> Iterator[tuple[Path, int, str]]:
    """(file, line, sentence) of pages, docstrings and messages."""
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        for number, line in enumerate(prose(page.read_text(encoding="utf-8")).splitlines(), 1):
            yield page, number, line
    for path in files(*PRODUCT):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
                yield path, node.lineno, " ".join(re.sub(r"`[^`]*`", "", node.value).split())


def files(*folders: str) -> list[Path]:
    return sorted(p for folder in folders for p in (ROOT / folder).rglob("*.py"))


def sizes() -> None:
    print(f"{'folder':<18}{'files':>7}{'lines':>9}{'code':>9}")
    total = Counter[str]()
    long: list[str] = []
    riddles = 0
    for folder in (*PRODUCT, "tests", BENCHMARKS):
        count = Counter[str]()
        for path in files(folder):
            if folder == "tests" and path.is_relative_to(ROOT / BENCHMARKS):
                continue
            text = path.read_text(encoding="utf-8")
            tree = ast.parse(text)
            lines = len(text.splitlines())
            count += Counter(files=1, lines=lines, code=code_lines(text, tree))
            if lines > LONG_FILE and folder in PRODUCT:
                long.append(f"{path.relative_to(ROOT)} ({lines})")
            if folder in PRODUCT:
                riddles += sum(bool(re.match(r"(What|Where|Which|How|Whether|Who|When)\b",
                                             str(s.value))) for s in docstrings(tree))
        print(f"{folder:<18}{count['files']:>7}{count['lines']:>9}{count['code']:>9}")
        if folder in PRODUCT:
            total += count
    print(f"{'product':<18}{total['files']:>7}{total['lines']:>9}{total['code']:>9}")
    print(f"\nfiles of more than {LONG_FILE} lines: {', '.join(long) or 'none'}")
    crowds = Counter(p.parent.relative_to(ROOT) for p in files(*PRODUCT, "tests"))
    print(f"folders of more than {MANY_FILES} files: " + (", ".join(
        f"{folder} ({n})" for folder, n in crowds.items() if n > MANY_FILES) or "none"))
    print(f"docstrings that open with What, Where, Which, How, Whether, Who, When: {riddles}")
    words = {page: len(prose(page.read_text(encoding="utf-8")).split())
             for page in sorted((ROOT / "docs").rglob("*.md"))}
    print(f"words of {len(words)} pages: {sum(words.values())}; of more than {LONG_PAGE}: "
          + (", ".join(f"{p.name} ({n})" for p, n in words.items() if n > LONG_PAGE) or "none"))


def jargon(show: bool) -> None:
    found = re.compile("|".join(rf"(?<![\w.-]){re.escape(word)}(?![\w-])" for word in
                                sorted(INSTEAD, key=len, reverse=True)), re.IGNORECASE)
    uses = [(path, line, m[0].lower())
            for path, line, text in texts() for m in found.finditer(text)]
    print(f"words that the glossary replaces: {len(uses)}")
    for path, line, word in uses if show else ():
        print(f"  {path.relative_to(ROOT)}:{line}: {word} -> {INSTEAD[word]}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--words", action="store_true", help="name each line with such a word")
    shown = parser.parse_args().words
    sizes()
    jargon(shown)
