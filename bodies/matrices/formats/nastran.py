"""Matrices DMIG of Nastran and OptiStruct in punch files, such as those of `EXTSEOUT(DMIGPCH)` and
`PARAM, EXTOUT, DMIGPCH` (MSC Nastran Quick Reference Guide, DMIG). Scalar points are unknowns
without a place."""

from pathlib import Path

import numpy as np

from sparsemor.bodies.matrices.formats.arrays import one_of
from sparsemor.bodies.matrices.formats.content import FileMatrix, labelled
from sparsemor.bodies.mesh.formats.content import decoded
from sparsemor.bodies.mesh.formats.nastran import Card, cards
from sparsemor.core import InputError

SQUARE, SYMMETRIC = 1, 6


def read(path: Path, name: str) -> FileMatrix:
    """The matrix called `name`, or the only one."""
    found: dict[str, list[Card]] = {}
    for card in cards(decoded(path.read_bytes())):
        if card.name == "DMIG":
            found.setdefault(card.text(0).upper(), []).append(card)
    if not found:
        raise InputError("it has no matrix DMIG")
    which = one_of(list(found), name.upper())
    head, *columns = found[which]
    if head.text(1) != "0" or head.integer(2) not in (SQUARE, SYMMETRIC) or head.integer(3) > 2:
        raise head.fail(f"{which}: a square or symmetric real matrix is needed, whose first card "
                        "is its header")
    entries: dict[tuple[tuple[int, int], tuple[int, int]], float] = {}
    for card in columns:
        column = card.integer(1), card.integer(2, 0)
        for at in range(4, len(card.fields), 4):
            if card.text(at):
                row = card.integer(at), card.integer(at + 1, 0)
                pair = (row, column) if head.integer(2) == SQUARE else (
                    min(row, column), max(row, column))
                entries[pair] = card.real(at + 2)
    if not entries:
        raise head.fail(f"{which} has no entries")
    both = np.array(list(entries), dtype=np.int64)
    return labelled(both[:, 0], both[:, 1], np.array(list(entries.values())))
