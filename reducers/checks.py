"""Checks of a reducer's options before the training run, by counting unknowns, rows and atoms."""

from collections.abc import Container, Iterable, Mapping, Sequence
from typing import Protocol

import numpy as np

from sparsemor.core import AssembledModel, Basis, Fault, Preconditioner, Sampler, SparseSolver
from sparsemor.core.model.block_patterns import matched_option, unmatched_patterns
from sparsemor.core.protocols.sparse_solver import solver_refusal
from sparsemor.reducers.coupled_blocks import coupling


class RowsAndAtoms(Protocol):
    @property
    def rows(self) -> int | None: ...
    @property
    def atoms(self) -> int | None: ...


def pattern_faults(model: AssembledModel, key: str, patterns: Iterable[str]) -> list[Fault]:
    """Block patterns that match no reducible block of any body; `key`: the option that contains
    them."""
    return unmatched_patterns(model.layout, key, patterns)


def budget_faults(
    model: AssembledModel, budgets: Mapping[str, RowsAndAtoms], sampler: Sampler
) -> list[Fault]:
    """Faults of budgets: patterns that match no block, and more rows than a block has unknowns."""
    faults = pattern_faults(model, "budgets", budgets)
    for name in model.reducible():
        pattern = pattern_of(name, budgets)
        asked = None if pattern is None else budgets[pattern].rows
        if asked is None:
            continue
        size, kept = block_size(model, name), required_rows(model, name, sampler)
        if asked > size - kept:
            more = f" in addition to the {kept} that joints and loads need" if kept else ""
            faults.append(Fault(
                f"budgets.{pattern}.rows", f"{asked} rows were requested of {name}, which has "
                f"{size - kept} unknowns to draw from{more}: take at most {size - kept}"))
    return faults


def preconditioner_faults(
    model: AssembledModel, budgets: Mapping[str, RowsAndAtoms], sampler: Sampler,
    preconditioner: Preconditioner, preconditioned: Sequence[str],
    basis: Basis, bases: Mapping[str, Basis],
) -> list[Fault]:
    """Blocks for whose shape the preconditioner is undefined, whatever dictionary the training run
    gives them.

    preconditioned: patterns of the blocks whose sampled rows are preconditioned.
    """
    faults, wanted = [], dict.fromkeys(preconditioned, True)
    for name in (n for n in model.reducible() if matched_option(n, wanted, False)):
        atoms = most_atoms(matched_option(name, bases, basis), block_size(model, name))
        pattern = pattern_of(name, budgets)
        asked = None if pattern is None else budgets[pattern].rows
        rows = default_rows(model, name, sampler, atoms) if asked is None else asked
        rows += required_rows(model, name, sampler)
        reason = preconditioner.check(rows, atoms)
        if reason and not compresses(preconditioner, rows, atoms):
            faults.append(Fault("preconditioner", f"{name}: {reason}"))
    return faults


def compresses(preconditioner: Preconditioner, rows: int, atoms: int) -> bool:
    """True if a preconditioner is undefined for so many sampled rows, but not for as many as atoms,
    to which the rows are then compressed by QR."""
    return rows > atoms and bool(preconditioner.check(rows, atoms)) and not (
        preconditioner.check(atoms, atoms))


def capability_faults(
    model: AssembledModel, budgets: Mapping[str, RowsAndAtoms], sampler: Sampler,
    solver: SparseSolver,
    basis: Basis, bases: Mapping[str, Basis], joint_problem: bool, compressed: Container[str],
) -> list[Fault]:
    """Missing capabilities of the sparse solver for the problems of this scene, as known before
    training. joint_problem: True if all elastic blocks are one nonlinear problem; compressed:
    blocks whose rows are compressed to as many as atoms.

    Problems with fewer rows than atoms cannot be predicted where the size of the dictionary is
    unknown; these are checked when the reduced model is prepared.
    """
    faults, joint, choosing = [], False, []
    for name in model.reducible():
        pattern = pattern_of(name, budgets)
        budget = None if pattern is None else budgets[pattern]
        if budget is None or budget.atoms is None:
            continue
        most = most_atoms(matched_option(name, bases, basis), block_size(model, name))
        if joint_problem and model.layout.block(name).kind.order == 2:
            choosing.append(name)
            joint = joint or budget.atoms < most
            continue
        own = default_rows(model, name, sampler, most) if budget.rows is None else budget.rows
        rows = own + required_rows(model, name, sampler)
        many = rows > most > budget.atoms and name not in compressed
        needs = frozenset({"overdetermined"} if many else ())
        why = solver_refusal(name, solver, needs)
        if why:
            faults.append(Fault("solver", why))
    if joint:
        why = solver_refusal(", ".join(choosing), solver, frozenset({"nonlinear", "unpenalised"}))
        if why:
            faults.append(Fault("solver", why))
    return faults


def resampling_faults(
    model: AssembledModel, resample: int | None, row_sets: int | None
) -> list[Fault]:
    """Faults of the resampling options: row sets without resampling, and new rows in every draw
    where local terms (radiation) would have to search the mesh for the elements of these rows."""
    if resample is None:
        return [Fault("row_sets", "rows are drawn only once: set the number of steps after which "
                      "they are drawn again (resample)")] if row_sets is not None else []
    local = [b.thermal for b in model.separated.heat if b.local]
    if row_sets is None and local:
        return [Fault("row_sets", f"rows of {', '.join(local)} have local terms such as "
                      "radiation, whose elements are found on the mesh: give a number of row sets, "
                      "which are prepared in advance")]
    return []


def coupled_faults(
    model: AssembledModel, budgets: Mapping[str, RowsAndAtoms], basis: Basis,
    bases: Mapping[str, Basis],
    resample: int | None,
) -> list[Fault]:
    """Options that are not available where a term couples bodies or acts on displacements by
    elements: resampling, and fewer active atoms than the dictionary has. Found by counting."""
    if not (model.separated.between or model.separated.elastic_local):
        return []
    faults = []
    if resample is not None:
        faults.append(Fault("resample", f"{_reason(model)}, whose elements are found on the mesh "
                            "for one set of rows: leave it out"))
    for name in (n for n in model.reducible() if n in unselectable_blocks(model)):
        pattern = pattern_of(name, budgets)
        atoms = None if pattern is None else budgets[pattern].atoms
        most = bound_of_atoms(matched_option(name, bases, basis), block_size(model, name))
        if atoms is not None and most is not None and atoms < most:
            faults.append(Fault(f"budgets.{pattern}.atoms", unselectable(model, name, atoms, most)))
    return faults


def unselectable_blocks(model: AssembledModel) -> set[str]:
    """Blocks whose atoms cannot be selected step by step: all blocks where a term couples bodies or
    acts on displacements by elements, otherwise the thermal blocks that are solved together."""
    if model.separated.other or model.separated.elastic_local:
        return set(model.reducible())
    return {name for c in model.separated.couplings for name in (c.rows, c.columns)}


def _reason(model: AssembledModel) -> str:
    if not model.separated.between:
        kinds = sorted({type(t).__name__ for t in model.separated.elastic_local})
        return f"{', '.join(kinds)} acts on displacements by elements"
    names = ", ".join(sorted({n for n, _ in coupling(model) if n})) or "a term"
    return f"{names} couples bodies inside the step"


def unselectable(model: AssembledModel, name: str, atoms: int, most: int) -> str:
    """Message that fewer than `most` atoms of a block cannot be selected where terms couple
    bodies."""
    return (f"{name}: {atoms} of {most} atoms would be selected in each step, which is not done "
            f"where {_reason(model)}: give as many atoms "
            "as the dictionary has, or leave them out")


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


def pattern_of(name: str, table: Mapping[str, object]) -> str | None:
    """The pattern in `table` that applies to a block; None if no pattern matches."""
    return matched_option(name, {pattern: pattern for pattern in table}, None)


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


def default_rows(model: AssembledModel, name: str, sampler: Sampler, atoms: int) -> int:
    """Number of rows drawn where the scene sets none: twice the number of atoms, limited to the
    number of unknowns that are not required rows."""
    left = block_size(model, name) - required_rows(model, name, sampler)
    return max(min(2 * atoms, left), 0)


def most_atoms(basis: Basis, size: int) -> int:
    """Upper bound of the number of atoms in a dictionary: that of the basis, or else `size`, the
    number of unknowns of the block."""
    bound = bound_of_atoms(basis, size)
    return size if bound is None else bound


def bound_of_atoms(basis: Basis, size: int) -> int | None:
    """Upper bound of the number of atoms that the options of a basis set for a block of `size`
    unknowns; None where the options set no bound."""
    return basis.most_atoms(size)
