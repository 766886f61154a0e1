"""Blocks of unknowns that terms act on: couplings between blocks, and elements per block."""

from collections.abc import Sequence

from sparsemor.core import AssembledModel, IntArray, Layout, ReducedTerm, Term


def touched(layout: Layout, rows: IntArray) -> frozenset[str]:
    """Names of the blocks that contain the equations `rows`."""
    return frozenset(layout.containing(rows))


def coupling(model: AssembledModel) -> tuple[tuple[str, frozenset[str]], ...]:
    """Name in the scene and coupled blocks of each term that acts between blocks."""
    found = []
    for term in model.separated.between:
        found.append((term.source, touched(model.layout, term.rows)))
    return tuple(found)


def elements(
    model: AssembledModel, terms: Sequence[Term | ReducedTerm], rows: Sequence[IntArray]
) -> dict[str, int]:
    """Reducible block -> number of elements that one evaluation of the terms integrates for its
    rows."""
    found = {name: 0 for name in model.reducible()}
    for term, at in zip(terms, rows, strict=True):
        for name in touched(model.layout, at) & found.keys():
            found[name] += term.elements
    return found
