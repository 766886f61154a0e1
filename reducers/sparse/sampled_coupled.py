"""Sampled rows of a model in which a term couples bodies: fixed supports, no selection."""

from collections.abc import Mapping
from typing import Protocol

from sparsemor.core import (
    AssembledModel,
    Basis,
    Dictionary,
    Fault,
    InputError,
    IntArray,
    Note,
    SolveFailed,
    Status,
    chosen,
)
from sparsemor.reducers.checks import RowsAndAtoms, block_size, bound_of_atoms, pattern_of
from sparsemor.reducers.full.monolithic import coupling
from sparsemor.reducers.sparse.sampled_block import RankDeficient, SampledElastic, SampledHeat
from sparsemor.reducers.step.acceptance import Tolerances
from sparsemor.reducers.step.coupled_reduced import ReducedGeneral, Seen, reduced_general
from sparsemor.reducers.step.operators import TestMap
from sparsemor.reducers.step.solver import Facts

ALL = "give as many atoms as the dictionary has, or leave them out"


class Iteration(Protocol):
    """The options of a reducer that are read here."""

    @property
    def predictor(self) -> int: ...
    @property
    def remaining(self) -> float: ...
    @property
    def max_iterations(self) -> int: ...


def sampled_general(
    model: AssembledModel, dictionaries: Mapping[str, Dictionary], limits: Mapping[str, float],
    rows: Mapping[str, IntArray], blocks: Mapping[str, SampledElastic | SampledHeat],
    maps: Mapping[str, TestMap], options: Iteration, notes: tuple[Note, ...], facts: Facts,
) -> ReducedGeneral:
    """maps: block -> its rows of the residual, before the preconditioner. Least squares of a
    block's rows as in the fast path. InputError where a budget leaves a choice of atoms."""
    faults = [Fault("reducer.budgets", _selects(model, s.block.name, s.block.budget, s.block.atoms))
              for s in blocks.values() if s.block.selects]
    if faults:
        raise InputError(faults)
    seen = {}
    for name, s in blocks.items():
        P, m = s.block.weight, maps[name]
        weighted = m if P is None else TestMap(m.rows, P if m.left is None else P @ m.left)
        try:
            left = s.block.left(None)
        except RankDeficient as error:
            raise SolveFailed(Status.RANK_DEFICIENT, 0.0, error.block, error.detail,
                              sampled=True) from None
        seen[name] = Seen(s.tested, left, weighted)
    return reduced_general(
        model, dictionaries, rows, seen,
        Tolerances(options.remaining, options.max_iterations), options.predictor, limits, notes,
        facts)


def coupled_faults(
    model: AssembledModel, budgets: Mapping[str, RowsAndAtoms], basis: Basis,
    bases: Mapping[str, Basis],
    resample: int | None,
) -> list[Fault]:
    """Faults of options that the general path does not support, by counting."""
    if not (model.separated.between or model.separated.elastic_local):
        return []
    faults = []
    if resample is not None:
        faults.append(Fault("resample", f"{_reason(model)}, whose elements are found on the mesh "
                            "for one set of rows: leave it out"))
    for name in model.reducible():
        pattern = pattern_of(name, budgets)
        atoms = None if pattern is None else budgets[pattern].atoms
        most = bound_of_atoms(chosen(name, bases, basis), block_size(model, name))
        if atoms is not None and most is not None and atoms < most:
            faults.append(Fault(f"budgets.{pattern}.atoms", _selects(model, name, atoms, most)))
    return faults


def _reason(model: AssembledModel) -> str:
    if not model.separated.between:
        kinds = sorted({type(t).__name__ for t in model.separated.elastic_local})
        return f"{', '.join(kinds)} acts on displacements by elements"
    names = ", ".join(sorted({n for n, _ in coupling(model) if n})) or "a term"
    return f"{names} couples bodies inside the step"


def _selects(model: AssembledModel, name: str, atoms: int, most: int) -> str:
    return (f"{name}: {atoms} of {most} atoms would be selected in each step, which is not done "
            f"where {_reason(model)}: {ALL}")
