"""Options by block pattern: `*.thermal`, `link1.*`, `link1.elastic`."""

from collections.abc import Iterable, Mapping
from fnmatch import fnmatchcase
from typing import TypeVar

from sparsemor.core.errors import Fault
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.registry.registry import suggestions

T = TypeVar("T")


def matched_option(name: str, table: Mapping[str, T], default: T) -> T:
    """The entry of the most exact pattern that fits `name`: fewest wildcards, then longest."""
    fits = [p for p in table if fnmatchcase(name, p)]
    if not fits:
        return default
    return table[min(fits, key=lambda p: (p.count("*") + p.count("?"), -len(p)))]


def unmatched_patterns(layout: Layout, key: str, patterns: Iterable[str]) -> list[Fault]:
    """Patterns that fit no block of any body, whatever fields it has: misspelt ones.

    The pattern of a field that bodies may have, and these have not, is accepted, so that one choice
    serves several scenes.
    """
    owners = {b.owner for b in layout.differential}
    fields = [kind.name for kind in layout.kinds if kind.reducible]
    blocks = sorted(f"{owner}.{field}" for owner in owners for field in fields)
    wild = [f"*.{field}" for field in fields]
    return [Fault(f"{key}.{p}", f"fits no block: {suggestions(p, [*wild, *blocks], 'blocks')}")
            for p in patterns if not any(matched_option(b, {p: True}, False) for b in blocks)]
