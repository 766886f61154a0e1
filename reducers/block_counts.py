"""Blocks of a model in numbers: unknowns, rows that every sample contains, atoms at most, elements
of their terms; blocks with local terms, and blocks that terms couple."""

from collections.abc import Sequence

import numpy as np

from sparsemor.core import (
    AssembledModel,
    Basis,
    IntArray,
    Layout,
    Preconditioner,
    ReducedTerm,
    Sampler,
    Term,
)


def compresses(preconditioner: Preconditioner, rows: int, atoms: int) -> bool:
    """True if a preconditioner is undefined for so many sampled rows, but not for as many as atoms,
    to which the rows are then compressed by QR."""
    return rows > atoms and bool(preconditioner.check(rows, atoms)) and not (
        preconditioner.check(atoms, atoms))


def local_blocks(model: AssembledModel) -> dict[str, str]:
    """Block -> names of the bodies, loads and contacts whose terms are evaluated element by element
    in each step there, e.g. radiation or a table of conductivity."""
    # id of a term -> its body, load or contact
    part = {id(term): name for name, terms in model.by_part.items() for term in terms}
    found: dict[str, list[str]] = {}
    for heat in model.separated.heat:
        for term in heat.local:
            found.setdefault(heat.thermal, []).append(part[id(term)])
    for term in (*model.separated.other, *model.separated.elastic_local):
        for name in model.reducible():
            at = model.layout[name]
            if np.any((term.rows >= at.start) & (term.rows < at.stop)):
                found.setdefault(name, []).append(
                    part.get(id(term), type(term).__name__))
    return {block: ", ".join(dict.fromkeys(names)) for block, names in found.items()}


def block_size(model: AssembledModel, name: str) -> int:
    """Number of unknowns of a block."""
    place = model.layout[name]
    return int(place.stop - place.start)


def required_rows(model: AssembledModel, name: str, sampler: Sampler) -> int:
    """Number of rows of a block that each sample contains in addition to the drawn ones: those that
    joints and localized loads act on."""
    kept = sampler.keeps
    if kept == "ring":
        return len(np.union1d(model.required[name], model.ring(name)))
    return len(model.required[name]) if kept == "required" else 0


def most_atoms(basis: Basis, size: int) -> int:
    """Upper bound of the number of atoms in a dictionary: that of the basis, or else `size`, the
    number of unknowns of the block."""
    bound = basis.most_atoms(size)
    return size if bound is None else bound


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
