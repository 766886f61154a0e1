"""Statements of an Abaqus input file: keyword, options, data lines, words, names and numbers."""

import re
from collections.abc import Iterator, Sequence

from sparsemor.bodies.mesh.formats.file_content import INTEGER, BadLine

_REAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(E[+-]?\d+)?", re.ASCII)


def statements(
    lines: Sequence[str]
) -> Iterator[tuple[int, str, dict[str, str], list[tuple[int, str]]]]:
    """Line, keyword (capitals, no blanks, without *), options and data lines (numbers and texts) of
    each statement, comments (**) and blank lines dropped. A head that ends with a comma goes on in
    the next line (open_head)."""
    start, head = 0, ""
    body: list[tuple[int, str]] = []
    open_head = False
    for number, raw in enumerate(lines, 1):
        text = raw.strip()
        if not text or text.startswith("**"):
            continue
        if open_head and not text.startswith("*"):
            head += text
            open_head = text.endswith(",")
        elif text.startswith("*"):
            if start:
                yield start, *_keyword(head, start), body
            start, head, body = number, text, []
            open_head = text.endswith(",")
        elif start:
            body.append((number, text))
        else:
            raise BadLine(number, text[:20], "data before the first keyword")
    if start:
        yield start, *_keyword(head, start), body


def _keyword(text: str, line: int) -> tuple[str, dict[str, str]]:
    """Keyword, without *, and options of a line `*KEYWORD, NAME=value`: names in upper case without
    spaces, values as they are, "" for an option without one. line: its number, for errors."""
    words = _words(text)
    keyword = re.sub(r"\s", "", words[0][1:]).upper()
    options: dict[str, str] = {}
    for word in words[1:]:
        name, _, value = word.partition("=")
        name = re.sub(r"\s", "", name).upper()
        if name in options:
            raise BadLine(line, "*" + keyword, f"{name[:40]} is given twice")
        if name:
            options[name] = value.strip()
    return keyword, options


def needed(options: dict[str, str], name: str, line: int, word: str) -> str:
    """Value of an option. Raises BadLine, with line and keyword, where it is missing."""
    if not options.get(name, "").strip('"'):
        raise BadLine(line, word, f"has no {name}=")
    return options[name]


def key_of(name: str) -> str:
    """Name under which Abaqus knows a set: in capitals unless quoted."""
    name = name.strip()
    return name[1:-1] if len(name) > 1 and name[0] == name[-1] == '"' else name.upper()


def shown(name: str) -> str:
    """A name of the file without quotes, for messages."""
    return name.strip().strip('"')


def _words(text: str) -> list[str]:
    """Words between commas, blanks around them dropped; commas inside quotes do not count."""
    if '"' not in text:
        words = [w.strip() for w in text.split(",")]
    else:
        words = [""]
        quoted = False
        for letter in text:
            quoted ^= letter == '"'
            if letter == "," and not quoted:
                words.append("")
            else:
                words[-1] += letter
        words = [w.strip() for w in words]
    return words


def data_words(text: str) -> tuple[list[str], bool]:
    """Words of a data line without empty ones at its end, and whether it ends with a comma."""
    words = _words(text)
    open_end = len(words) > 1 and not words[-1]
    while words and not words[-1]:
        words.pop()
    return words, open_end


def integer(word: str, line: int, keyword: str) -> int:
    """Whole number. Raises BadLine for another word."""
    if not INTEGER.fullmatch(word):
        raise BadLine(line, keyword, f"{word[:40]!r} is no whole number")
    return int(word)


def real(word: str, line: int, keyword: str) -> float:
    """Number with an exponent E or D; an empty word is 0."""
    if not word:
        return 0.0
    text = word.upper().replace("D", "E")
    if not _REAL.fullmatch(text):
        raise BadLine(line, keyword, f"{word[:40]!r} is no number")
    return float(text)
