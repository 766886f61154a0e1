"""Blocks that are reduced to fewer atoms than there could be, or were asked for."""

from sparsemor.core import Check, Findings, Note, PreparedRun, Scene, StepSolver, information
from sparsemor.core.model.block_patterns import matched_option
from sparsemor.plugins.checks import place


class FewAtoms(Check):
    """Blocks that are reduced to one atom, or to fewer than were asked for."""

    order = place("few_atoms")

    def before_steps(self, run: PreparedRun, again: PreparedRun | None) -> Findings:
        return Findings(of_solver(run.scene, run.solver))


def of_solver(scene: Scene, solver: StepSolver) -> tuple[Note, ...]:
    """Warnings about blocks that are reduced to one atom (basis vector) although more exist;
    information on those that have fewer atoms than the options ask for."""
    found = []
    for name, d in solver.dictionaries.items():
        rank = d.info.get("numerical_rank", d.info.get("rank_at_least", 2))
        if d.atoms.shape[1] == 1 and isinstance(rank, int) and rank > 1:
            found.append(Note(
                f"{name} is reduced to 1 atom for {len(d.offset)} unknowns: it can only grow and "
                "shrink in one shape; take more atoms", "one_atom"))
        have, asked = d.atoms.shape[1], _asked(scene, name)
        if 0 < have < asked:
            found.append(information(
                f"{name}: {asked} atoms are asked for, and {have} exist"
                + (f", one for each of its {len(d.offset)} unknowns" if have == len(d.offset) else
                   "; a basis has no more than its snapshots or modes span"), "fewer_atoms"))
    return tuple(found)


def _asked(scene: Scene, block: str) -> int:
    """Number of atoms that the options of a reducer and of its basis ask for in a block, 0 if they
    do not limit it."""
    reducer = scene.reducer
    chosen = reducer.trial_bases()
    if chosen is None:
        return 0
    count = getattr(matched_option(block, chosen.others, chosen.shared), "count", None)
    budget = matched_option(block, getattr(reducer, "budgets", {}), None)
    limits = (count, getattr(budget, "atoms", None))
    return max((n for n in limits if isinstance(n, int)), default=0)
