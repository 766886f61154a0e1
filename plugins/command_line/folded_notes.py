"""Notes on several runs as few sentences."""

import re
from collections.abc import Iterable, Mapping


def folded(notes: Mapping[str, Iterable[str]], owners: Iterable[str]) -> list[str]:
    """Sentences of several runs, those that differ in nothing but numbers and names as one: the
    first of them, with the runs before it and the blocks and bodies of the others behind it.

    notes: run -> its sentences, "" for the only run; owners: names of bodies and joints.
    """
    names = "|".join(sorted(map(re.escape, owners), key=len, reverse=True))
    subject = re.compile(rf"(?<![\w.])(?:{names})(?:\.\w+)?\b" if names else "(?!)")
    option = re.compile(rf"(?<=\w\.)(?:{names})\b" if names else "(?!)")  # as in bodies.NAME.order
    first: dict[str, str] = {}
    about: dict[str, dict[str, list[str]]] = {}
    for run, texts in notes.items():
        for text in texts:
            # form: the sentence with # for names and 0 for numbers, a list of these as one of them
            masked = _NUMBER.sub("0", option.sub("#", subject.sub("#", text)))
            form = _LIST.sub(r"\1", masked)
            first.setdefault(form, text)
            about.setdefault(form, {}).setdefault(run, []).extend(subject.findall(text))
    return [_one(first[form], found, set(subject.findall(first[form])))
            for form, found in about.items()]


_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
_LIST = re.compile(r"(#(?: 0 %)?)(?:,? (?:and )?\1)+")
"""List of names, or of names with percentages, in a sentence without its names and numbers."""


def _one(text: str, about: Mapping[str, Iterable[str]], named: set[str]) -> str:
    """A sentence with the runs it is about, and the names that are not in it."""
    more = {run: [n for n in dict.fromkeys(names) if n not in named]
            for run, names in about.items()}
    lists = [", ".join(names) for names in more.values()]
    if any(others != lists[0] for others in lists):
        lists = [f"{run}: {', '.join(names)}" for run, names in more.items() if names]
        lists = ["; ".join(lists)]
    runs = ", ".join(filter(None, about))
    return (f"{runs}: " if runs else "") + text + (f" (also {lists[0]})" if lists[0] else "")
