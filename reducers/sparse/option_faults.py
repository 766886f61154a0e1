"""Faults of the options of the sparse reducer, found before the training run by counting unknowns,
rows and atoms."""

from collections.abc import Container

from sparsemor.core import AssembledModel, Fault
from sparsemor.core.model.block_patterns import matched_option, unmatched_patterns
from sparsemor.core.protocols.sparse_solver import solver_refusal
from sparsemor.reducers.block_counts import (
    block_size,
    compresses,
    coupling,
    most_atoms,
    required_rows,
)
from sparsemor.reducers.sparse.sparse_options import Budget, SparseOptions


def budget_of(options: SparseOptions, name: str) -> tuple[str | None, Budget]:
    """Pattern and budget that apply to a block; None where no pattern matches."""
    return matched_option(name, {p: (p, b) for p, b in options.budgets.items()}, (None, Budget()))


def counted_rows(model: AssembledModel, options: SparseOptions, name: str, atoms: int) -> int:
    """Number of rows of a block with so many atoms: those drawn, by default twice the number of
    atoms but at most all, and the required ones."""
    rows, kept = budget_of(options, name)[1].rows, required_rows(model, name, options.sampler)
    if rows is None:
        rows = max(min(2 * atoms, block_size(model, name) - kept), 0)
    return rows + kept


def largest_dictionary(model: AssembledModel, options: SparseOptions, name: str) -> int:
    """Upper bound of the number of atoms of a block."""
    return most_atoms(matched_option(name, options.bases, options.basis), block_size(model, name))


def budget_faults(model: AssembledModel, options: SparseOptions) -> list[Fault]:
    """Faults of budgets: patterns that match no block, and more rows than a block has unknowns."""
    faults = unmatched_patterns(model.layout, "budgets", options.budgets)
    for name in model.reducible():
        pattern, budget = budget_of(options, name)
        size, kept = block_size(model, name), required_rows(model, name, options.sampler)
        if budget.rows is not None and budget.rows > size - kept:
            more = f" in addition to the {kept} that joints and loads need" if kept else ""
            faults.append(Fault(
                f"budgets.{pattern}.rows", f"{budget.rows} rows were requested of {name}, which "
                f"has {size - kept} unknowns to draw from{more}: take at most {size - kept}"))
    return faults


def preconditioner_faults(model: AssembledModel, options: SparseOptions) -> list[Fault]:
    """Blocks for whose shape the preconditioner is undefined, whatever dictionary the training run
    gives them."""
    faults, wanted = [], dict.fromkeys(options.preconditioned, True)
    for name in (n for n in model.reducible() if matched_option(n, wanted, False)):
        atoms = largest_dictionary(model, options, name)
        rows = counted_rows(model, options, name, atoms)
        reason = options.preconditioner.check(rows, atoms)
        if reason and not compresses(options.preconditioner, rows, atoms):
            faults.append(Fault("preconditioner", f"{name}: {reason}"))
    return faults


def capability_faults(
    model: AssembledModel, options: SparseOptions, compressed: Container[str]
) -> list[Fault]:
    """Missing capabilities of the sparse solver for the problems of this scene, as known before
    training. compressed: blocks whose rows are compressed to as many as atoms. overdetermined: more
    rows than atoms; nonlinear, unpenalised: the joint problem of all elastic blocks, in which rigid
    coordinates and joint forces are always active.

    Problems with fewer rows than atoms cannot be predicted where the size of the dictionary is
    unknown; these are checked when the reduced model is prepared.
    """
    # problems: name of a block, or names of several -> capabilities that it needs
    problems, joint, choosing = dict[str, frozenset[str]](), False, []
    for name in model.reducible():
        atoms, most = budget_of(options, name)[1].atoms, largest_dictionary(model, options, name)
        if atoms is None:  # all atoms are active
            continue
        if options.selection == "joint" and model.layout.block(name).kind.order == 2:
            choosing.append(name)
            joint = joint or atoms < most
            continue
        # atoms are selected (most > atoms) by more rows than there are atoms
        many = counted_rows(model, options, name, most) > most > atoms and name not in compressed
        problems[name] = frozenset({"overdetermined"} if many else ())
    if joint:
        problems[", ".join(choosing)] = frozenset({"nonlinear", "unpenalised"})
    return [Fault("solver", why) for name, needs in problems.items()
            if (why := solver_refusal(name, options.solver, needs))]


def resampling_faults(model: AssembledModel, options: SparseOptions) -> list[Fault]:
    """Faults of the resampling options: row sets without resampling, and new rows in every draw
    where local terms (radiation) would have to search the mesh for the elements of these rows."""
    if options.resample is None:
        return [Fault("row_sets", "rows are drawn only once: set the number of steps after which "
                      "they are drawn again (resample)")] if options.row_sets is not None else []
    local = [b.thermal for b in model.separated.heat if b.local]
    if options.row_sets is None and local:
        return [Fault("row_sets", f"rows of {', '.join(local)} have local terms such as "
                      "radiation, whose elements are found on the mesh: give a number of row sets, "
                      "which are prepared in advance")]
    return []


def coupled_faults(model: AssembledModel, options: SparseOptions) -> list[Fault]:
    """Options that are not available where a term couples bodies or acts on displacements by
    elements: resampling, and fewer active atoms than the dictionary has. Found by counting."""
    if not (model.separated.between or model.separated.elastic_local):
        return []
    faults = []
    if options.resample is not None:
        faults.append(Fault("resample", f"{_reason(model)}, whose elements are found on the mesh "
                            "for one set of rows: leave it out"))
    for name in (n for n in model.reducible() if n in unselectable_blocks(model)):
        pattern, budget = budget_of(options, name)
        most = matched_option(name, options.bases, options.basis).most_atoms(
            block_size(model, name))
        if budget.atoms is not None and most is not None and budget.atoms < most:
            faults.append(Fault(f"budgets.{pattern}.atoms",
                                unselectable(model, name, budget.atoms, most)))
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
