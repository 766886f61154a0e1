"""Information on steps whose Jacobian the scene's linear solvers do not solve."""

from collections.abc import Iterable

from sparsemor.core import AssembledModel, InputError, Note, Registry, information

GENERAL = ("auto", "splu")
"""Linear solvers that mean SuperLU where a matrix is not symmetric, or changes in each iteration;
all others take symmetric, positive definite matrices that stay."""


def asked_for(model: AssembledModel, blocks: Iterable[str]) -> dict[str, str]:
    """Block -> name of its linear solver, of those that the scene chose against SuperLU."""
    registry, found = Registry(), dict[str, str]()
    for block in blocks:
        kind = type(model.solvers.of(block))
        try:
            name = registry.name_of("linear_solver", kind)
        except InputError:  # not registered: made in a program
            name = kind.__name__
        if name not in GENERAL:
            found[block] = name
    return found


def whole_step_notes(model: AssembledModel, why: str) -> tuple[Note, ...]:
    """Notes for models whose unknowns are solved together; why: the reason."""
    asked = asked_for(model, model.reducible())
    if not asked:
        return ()
    blocks = ", ".join(f"{solver} for {block}" for block, solver in asked.items())
    return (information(
        f"linear_solver: steps are solved with splu, not with {blocks}: {why}, and a Jacobian of "
        "all unknowns is not symmetric positive definite", "linear_solver"),)


def local_heat_notes(model: AssembledModel) -> tuple[Note, ...]:
    """Notes on local terms, such as radiation, that are iterated with a changing matrix."""
    asked = asked_for(model, [b.thermal for b in model.separated.heat if b.local])
    return tuple(information(
        f"linear_solver: {solver} solves the constant part of {block}; where its local terms, such "
        "as radiation, outweigh that part, Newton steps are solved with splu, because their matrix "
        "changes in each", "linear_solver") for block, solver in asked.items())
