"""Command `sparsemor cache`: contents and size of the cache of offline results."""

import re
from collections import Counter
from typing import Annotated

import typer

from sparsemor.core.cli.exit_codes import print_json
from sparsemor.core.errors import InputError
from sparsemor.plugins.command_line.options import Json, Quiet, located_in

UNITS = {"": 1, "k": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}


def cache(
    limit: Annotated[str | None, typer.Option(
        "--limit", metavar="SIZE", help="Remove the entries that were not used for the longest "
        "time until the others have at most this size, such as 2GB or 500MB.")] = None,
    clear: Annotated[bool, typer.Option("--clear", help="Remove all entries.")] = False,
    as_json: Json = False, quiet: Quiet = False,
) -> None:
    """Show the cache of offline results (snapshots, bases), or reduce its size."""
    with located_in():
        from sparsemor.core.simulation.cache import Cache, Removal

        store = Cache()
        if clear and limit is not None:
            raise InputError("give either --limit or --clear", "limit")
        most = 0 if clear else None if limit is None else bytes_of(limit)
        done = Removal(0, 0) if most is None else store.reduce(most)
        sizes: Counter[str] = Counter()
        there = store.contents()
        for entry in there.entries:
            sizes[entry.kind] += entry.size
        if as_json:
            print_json({"folder": str(store.root), "bytes": dict(sizes), "freed": done.freed,
                        "not_removed": done.kept, "unreadable": there.unreadable})
        elif not quiet:
            for kind, size in sorted(sizes.items()):
                typer.echo(f"{kind:<20} {in_words(size):>10}")
            typer.echo(f"{store.root}: {in_words(sizes.total())}"
                       + (f", {in_words(done.freed)} removed" if most is not None else ""))
            for count, what in ((done.kept, "removed"), (there.unreadable, "read")):
                if count:
                    noun = "entry" if count == 1 else "entries"
                    typer.echo(f"{count} {noun} could not be {what}")


def bytes_of(text: str) -> int:
    """Bytes of a size such as 2GB, 500 MB or 0. InputError for other text."""
    found = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([kMGT]?)B?\s*", text)
    if found is None:
        raise InputError(f"give a size such as 2GB or 500MB (got {text!r})", "limit")
    return round(float(found[1]) * UNITS[found[2]])


def in_words(size: int) -> str:
    """A number of bytes in the largest unit that it fills."""
    unit = next((u for u, n in reversed(UNITS.items()) if size >= n), "")
    return f"{size / UNITS[unit]:.3g} {unit}B"
