"""Options by block pattern: `*.thermal`, `link1.*`, `link1.elastic`."""

from collections.abc import Mapping
from fnmatch import fnmatchcase
from typing import TypeVar

T = TypeVar("T")


def chosen(name: str, table: Mapping[str, T], default: T) -> T:
    """The entry of the most exact pattern that fits `name`: fewest wildcards, then longest."""
    fits = [p for p in table if fnmatchcase(name, p)]
    if not fits:
        return default
    return table[min(fits, key=lambda p: (p.count("*") + p.count("?"), -len(p)))]
