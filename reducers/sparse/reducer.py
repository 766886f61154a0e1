"""Sparse projection-free reducer: coefficients of few atoms from sampled rows of the full-order
equations."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

from sparsemor.core import (
    AssembledModel,
    BlockBases,
    BlockBudget,
    Fault,
    InputError,
    ReducedProblem,
    StepSolver,
)
from sparsemor.core.model.block_patterns import matched_option, unmatched_patterns
from sparsemor.reducers.block_counts import local_blocks
from sparsemor.reducers.reducer_options import BASES, counted, of_field
from sparsemor.reducers.sparse.option_faults import (
    budget_faults,
    capability_faults,
    coupled_faults,
    preconditioner_faults,
    resampling_faults,
)
from sparsemor.reducers.sparse.residual_rows import (
    inverted_blocks,
    unweighed,
)
from sparsemor.reducers.sparse.sparse_options import Budget, SparseOptions


class Sparse(SparseOptions):
    """Sparse projection-free reduction: few coefficients recovered from sampled rows (Eq. 25).

    Where a budget is at least the size of the dictionary, all atoms are active and none are
    selected.
    """

    shared_options: ClassVar[tuple[str, ...]] = (*BASES, "budgets")

    @property
    def keeps_joint_rows(self) -> bool:
        return True

    @property
    def stored_classes(self) -> Sequence[object]:
        """Classes of the step solvers of a kept model."""
        from sparsemor.reducers.stored_classes import CLASSES

        return CLASSES

    def field_budget(self, field: str) -> BlockBudget | None:
        found = of_field(field, self.budgets)
        return None if found is None else BlockBudget(found.rows, found.atoms)

    def active_atoms(self, name: str, atoms: int) -> int:
        return min(matched_option(name, self.budgets, Budget()).atoms or atoms, atoms)

    def with_rows(self, rows: Mapping[str, int]) -> "Sparse":
        return self.model_copy(update={"budgets": self._varied("rows", rows)})

    def with_atoms(self, atoms: Mapping[str, int]) -> "Sparse":
        basis, bases = counted(atoms, self.basis, self.bases)
        return self.model_copy(update={
            "budgets": self._varied("atoms", atoms), "basis": basis, "bases": bases})

    def _varied(self, option: str, counts: Mapping[str, int]) -> dict[str, Budget]:
        """Budgets by field with another number of rows or atoms each; they are validated with the
        scene."""
        return {f"*.{field}": (of_field(field, self.budgets) or Budget()).model_copy(
            update={option: n}) for field, n in counts.items()}

    def trial_bases(self) -> BlockBases:
        return BlockBases(self.basis, self.bases)

    def restart_refusal(self) -> str:
        return "" if self.resample is None else (
            "the rows of this reducer change with the steps, so steps of different size cannot be "
            "compared: keep its rows (leave out reducer.resample), or leave out time.control")

    def prepare(self, problem: ReducedProblem) -> StepSolver:
        faults = self.check(problem.model)
        if faults:
            raise InputError(faults).under("reducer")
        from sparsemor.reducers.sparse.step_solver import step_solver

        return step_solver(self, problem)

    def check(self, model: AssembledModel) -> Sequence[Fault]:
        """Faults of the options found by counting, before any training; each has the option to be
        changed, keys relative to the reducer."""
        layout = model.layout
        faults = budget_faults(model, self)
        faults += unmatched_patterns(layout, "bases", self.bases)
        faults += unmatched_patterns(layout, "preconditioned", self.preconditioned)
        faults += preconditioner_faults(model, self)
        # all rows of D^-1 r, where they are not sampled, are compressed to as many as atoms
        faults += capability_faults(model, self, compressed={
            n for n in inverted_blocks(model, self) if not self.samples(n)})
        faults += resampling_faults(model, self)
        faults += self._residual_faults(model)
        if not isinstance(self.carried, bool):
            faults += unmatched_patterns(layout, "carried", self.carried)
            if self.polish:
                faults.append(Fault("carried", "selections in a step that is solved again start "
                                    "together: take true or false, or polish: false"))
        faults += coupled_faults(model, self)
        if not self.polish and self.every > 1:
            faults.append(Fault("every", "without polish each step needs its own selection: "
                                "take every: 1"))
        if not self.polish and self.selection != "joint":
            faults.append(Fault("selection", "without polish the solution of the problem of all "
                                "blocks is used: take selection: joint"))
        local = [b.thermal for b in model.separated.heat if b.local]
        if not self.polish and local:
            faults.append(Fault("polish", f"the selection in {', '.join(local)} is linear and "
                                "leaves radiation to the polish: take polish: true"))
        return faults

    def _residual_faults(self, model: AssembledModel) -> list[Fault]:
        """Faults of the option `residual`: patterns without a block, and sampling D^-1 r where a
        step, or a draw of rows, would need operations with the whole mesh."""
        faults = ([] if isinstance(self.residual, str) else
                  unmatched_patterns(model.layout, "residual", self.residual))
        inverted = [n for n in model.reducible() if self.residual_of(n) == "preconditioned"]
        # block -> names of its local terms, and why these have no element weights
        local, whole = local_blocks(model), unweighed(model, self)
        for name in inverted:
            if name in whole:
                faults.append(Fault("residual", (
                    f"a row of D^-1 r reads all of r in {name}, and so every element of "
                    f"{local[name]} in each step, because {whole[name].format(local[name])}: take "
                    "plain rows there (auto does), or a reducer that evaluates all of them, such "
                    "as galerkin")))
        if inverted and self.resample is not None and self.row_sets is None:
            faults.append(Fault("row_sets", (
                f"each draw of rows of D^-1 r in {', '.join(inverted)} takes solves with the whole "
                "operator: give a number of row sets, which are prepared in advance")))
        return faults
