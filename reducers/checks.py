"""Numbers of rows and atoms that options ask of a block, and blocks with local terms."""


import numpy as np

from sparsemor.core import AssembledModel, Basis, Preconditioner, Sampler


def compresses(preconditioner: Preconditioner, rows: int, atoms: int) -> bool:
    """True if a preconditioner is undefined for so many sampled rows, but not for as many as atoms,
    to which the rows are then compressed by QR."""
    return rows > atoms and bool(preconditioner.check(rows, atoms)) and not (
        preconditioner.check(atoms, atoms))








def local_blocks(model: AssembledModel) -> dict[str, str]:
    """Block -> names of the bodies, loads and contacts whose terms are evaluated element by element
    in each step there, e.g. radiation or a table of conductivity."""
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
