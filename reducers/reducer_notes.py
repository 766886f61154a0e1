"""Notes on a reduced model: options without effect, linear solvers that are not used, unsampled
loads."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from sparsemor.core import (
    AssembledModel,
    InputError,
    IntArray,
    Note,
    Plugin,
    Registry,
    Slot,
    information,
)
from sparsemor.core.model.block_patterns import matched_option

NO_EFFECT = "no_effect"
"""Kind of the notes on options without effect."""
OF_A_SELECTION = ("solver", "selection", "hysteresis", "every", "carried", "polish")
"""Options of the reducer `sparse` that have an effect only where atoms are selected."""
UNSAMPLED = "unsampled"
"""Kind of the notes on loads and joints that act on no sampled row."""
WORSE = 10.0
"""Ratio of condition numbers, after and before a preconditioner, from which on a note says so."""
KEEP = "keep the required rows (sampler.required: true) or sample more rows"
GENERAL = ("auto", "splu")
"""Linear solvers that use SuperLU for matrices that are unsymmetric or change in each iteration;
all others require constant symmetric positive definite matrices."""


def changed(reducer: Plugin, options: Sequence[str]) -> list[str]:
    """Names among `options` whose value differs from the default."""
    return [name for name in options if not is_default(reducer, name)]


def is_default(reducer: Plugin, name: str) -> bool:
    """True if an option of a reducer has its default value."""
    field, value = type(reducer).model_fields[name], dict(reducer)[name]
    slot = next((m for m in field.metadata if isinstance(m, Slot)), None)
    if slot is None or not isinstance(field.default, str):
        return bool(value == field.get_default(call_default_factory=True))
    return bool(value == Registry().get(slot.kind, field.default)())


def no_effect(options: Sequence[str], why: str) -> tuple[Note, ...]:
    """One note that these options have no effect, for the reason `why`; no note for no options."""
    if not options:
        return ()
    names = ", ".join(f"reducer.{name}" for name in options)
    verb = "has" if len(options) == 1 else "have"
    return (Note(f"{names} {verb} no effect: {why}", NO_EFFECT),)


def worse_conditioned(
    name: str, facts: Mapping[str, float | int | str]
) -> tuple[Note, ...]:
    """Note on a preconditioner that makes the sampled rows of a block worse conditioned; facts: the
    condition numbers before and after it (`row_facts`)."""
    before, after = (float(facts.get(key, 0.0)) for key in ("condition", "condition_after"))
    if not 0.0 < WORSE * before < after:
        return ()
    return (information(
        f"reducer.preconditioner: the sampled rows of {name} have condition number {before:.2g} "
        f"without it and {after:.2g} with it, which makes selections from few rows less accurate: "
        "take parseval, or untf with products: 1", "worse_conditioned"),)


def unselected(reducer: Plugin, active: Mapping[str, tuple[int, int]]) -> tuple[Note, ...]:
    """Note on selection options where every budget covers its dictionary. active: block -> (largest
    number of active atoms, atoms in the dictionary)."""
    if not active or any(budget < atoms for budget, atoms in active.values()):
        return ()
    counts = ", ".join(f"{name} {atoms} of {atoms}" for name, (_, atoms) in active.items())
    return no_effect(changed(reducer, OF_A_SELECTION), (
        f"every budget covers its dictionary ({counts} atoms), so that nothing is selected; give "
        "fewer atoms in reducer.budgets, or leave this out"))


def shadowed_basis(
    reducer: Plugin, model: AssembledModel, bases: Mapping[str, object]
) -> tuple[Note, ...]:
    """Note on a changed option `basis` where `bases` (block pattern -> basis) sets the basis of
    every block, or where the scene has no block to reduce."""
    named_in_bases = dict.fromkeys(bases, True)
    if not all(matched_option(name, named_in_bases, False) for name in model.reducible()):
        return ()
    return no_effect(changed(reducer, ["basis"]), (
        "no body of the scene has a field that is reduced" if not model.reducible() else
        f"reducer.bases ({', '.join(bases)}) names the basis of every block; change it there"))


def unread_sampler(
    reducer: Plugin, sizes: Mapping[str, tuple[int, int]]
) -> tuple[Note, ...]:
    """Note on a changed sampler where all rows are taken. sizes: block -> (sampled rows,
    unknowns)."""
    if any(rows < unknowns for rows, unknowns in sizes.values()):
        return ()
    counts = ", ".join(f"{name} {n}" for name, (_, n) in sizes.items())
    return no_effect(changed(reducer, ["sampler"]), (
        f"all rows of every block are taken ({counts}); ask for fewer rows in reducer.budgets"))


def unweighted(
    reducer: Plugin, model: AssembledModel, patterns: Sequence[str]
) -> tuple[Note, ...]:
    """Note on a preconditioner that applies to no block, or on preconditioned blocks without a
    preconditioner. patterns: of the blocks to precondition."""
    named = dict.fromkeys(patterns, True)
    if not any(matched_option(name, named, False) for name in model.reducible()):
        return no_effect(changed(reducer, ["preconditioner"]), (
            f"reducer.preconditioned ({', '.join(patterns) or 'empty'}) names no block of this "
            "scene"))
    if is_default(reducer, "preconditioner"):
        return no_effect(changed(reducer, ["preconditioned"]), (
            "reducer.preconditioner is none"))
    return ()


def unsampled_loads(
    model: AssembledModel, rows: Mapping[str, IntArray], hint: str = KEEP
) -> tuple[Note, ...]:
    """A note for each load or joint that acts on none of the sampled rows (m,) of a block; hint:
    advice."""
    return tuple(
        Note(f"no sampled row of {block} is one that {name} acts on: it has no effect there; "
             f"{hint}", UNSAMPLED)
        for block, chosen_rows in rows.items()
        for name, touched in model.loaded[block].items()
        if not np.isin(touched, chosen_rows).any())


def asked_for(model: AssembledModel, blocks: Iterable[str]) -> dict[str, str]:
    """Block -> name of its linear solver, for blocks whose linear solver is neither `auto` nor
    `splu`."""
    registry, found = Registry(), dict[str, str]()
    for block in blocks:
        kind = type(model.linear_solver(block))
        try:
            name = registry.name_of("linear_solver", kind)
        except InputError:  # not registered: made in a program
            name = kind.__name__
        if name not in GENERAL:
            found[block] = name
    return found


def whole_step_notes(model: AssembledModel, why: str) -> tuple[Note, ...]:
    """Note on linear solvers that are not used because all unknowns are solved together; why: the
    reason."""
    asked = asked_for(model, model.reducible())
    if not asked:
        return ()
    blocks = ", ".join(f"{solver} for {block}" for block, solver in asked.items())
    return (information(
        f"linear_solver: steps are solved with splu, not with {blocks}: {why}, and a Jacobian of "
        "all unknowns is not symmetric positive definite", "linear_solver"),)


def local_heat_notes(model: AssembledModel) -> tuple[Note, ...]:
    """Notes on linear solvers of thermal blocks with radiation or other local terms, whose Jacobian
    changes in each iteration."""
    asked = asked_for(model, [b.thermal for b in model.separated.heat if b.local])
    return tuple(information(
        f"linear_solver: {solver} solves the constant part of {block}; where its local terms, such "
        "as radiation, outweigh that part, Newton steps are solved with splu, because their matrix "
        "changes in each", "linear_solver") for block, solver in asked.items())
