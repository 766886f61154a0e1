"""Options that apply to blocks of unknowns by name pattern: `*.thermal`, `link1.*`,
`link1.elastic`."""

from collections.abc import Iterable, Mapping
from fnmatch import fnmatchcase
from typing import TypeVar

from sparsemor.core.errors import Fault
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.registry.registry import suggestions

T = TypeVar("T")


def matched_option(name: str, table: Mapping[str, T], default: T) -> T:
    """Value of the most specific pattern that matches the block name `name`: fewest wildcards, then
    longest; `default` if none matches."""
    fits = [p for p in table if fnmatchcase(name, p)] if table else []
    if not fits:
        return default
    return table[min(fits, key=lambda p: (p.count("*") + p.count("?"), -len(p)))]


def unmatched_patterns(layout: Layout, key: str, patterns: Iterable[str]) -> list[Fault]:
    """Errors for misspelt patterns, which match no block of unknowns that any of the bodies could
    have.

    A pattern for a field that a body type supports but that is not switched on is accepted, so that
    one setting serves several inputs.
    """
    owners = {b.owner for b in layout.differential}
    fields = [kind.name for kind in layout.kinds if kind.reducible]
    blocks = sorted(f"{owner}.{field}" for owner in owners for field in fields)
    wild = [f"*.{field}" for field in fields]
    return [Fault(f"{key}.{p}", f"fits no block: {suggestions(p, [*wild, *blocks], 'blocks')}")
            for p in patterns if not any(matched_option(b, {p: True}, False) for b in blocks)]
