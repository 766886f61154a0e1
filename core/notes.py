"""Notes on a run: warnings, which cast doubt on its result, and information on how it was computed.

A note carries a stable `kind`, so that programs count and select notes without reading sentences.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum


class Level(StrEnum):
    """Severity of a note."""

    WARNING = "warning"
    INFORMATION = "information"


@dataclass(frozen=True, slots=True)
class Note:
    """Message to the user about a run, one sentence.

    text: the sentence, with the number that shows it; kind: a stable key, such as `unsampled`, that
    tests and tables select by; level: warning (the default) or information.
    """

    text: str
    kind: str = ""
    level: Level = Level.WARNING

    def __str__(self) -> str:
        return self.text


def information(text: str, kind: str = "") -> Note:
    """Note of level information, which casts no doubt on the result."""
    return Note(text, kind, Level.INFORMATION)


def sentences(notes: Iterable[Note], level: Level) -> list[str]:
    """Texts of the notes of one level, each once, in order."""
    return list(dict.fromkeys(n.text for n in notes if n.level is level))


def kinds(notes: Iterable[Note]) -> list[str]:
    """Kinds of all warnings, each once, in order."""
    return list(dict.fromkeys(n.kind for n in notes if n.kind and n.level is Level.WARNING))
