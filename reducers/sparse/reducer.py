"""The paper's reducer: sampled rows of the full-order equations, sparse coefficients, no
projection."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator

from sparsemor.core import (
    AssembledModel,
    Basis,
    BlockBudget,
    Dictionary,
    Fault,
    InputError,
    IntArray,
    Note,
    OfflineProducts,
    Plugin,
    Preconditioner,
    ReducedProblem,
    Sampler,
    Slot,
    SparseSolver,
    StepFactors,
    StepSolver,
    chosen,
    slot_default,
)
from sparsemor.reducers.checks import (
    block_size,
    budget_faults,
    capability_faults,
    default_rows,
    local_blocks,
    pattern_faults,
    preconditioner_faults,
    resampling_faults,
)
from sparsemor.reducers.field_options import BASES, counted, of_field
from sparsemor.reducers.ineffective_options import (
    shadowed_basis,
    unread_sampler,
    unselected,
    unweighted,
)
from sparsemor.reducers.sparse.build import Build, Whole
from sparsemor.reducers.sparse.resampling import Resampled, Streams, branched
from sparsemor.reducers.sparse.sampled_block import choose_rows
from sparsemor.reducers.sparse.sampled_coupled import coupled_faults
from sparsemor.reducers.step.prepare import constants
from sparsemor.reducers.trial_bases import trial_bases

Residual = Literal["plain", "preconditioned"]


class Budget(Plugin):
    """Budget of one block: rows and atoms that a step may use."""

    rows: int | None = Field(default=None, ge=0)
    """Sampled rows, on top of the required ones; twice the atoms of the dictionary, or as many as
    there are, when not given."""
    atoms: int | None = Field(default=None, ge=1)
    """Most atoms active at once; all of the dictionary when not given."""


class Sparse(Plugin):
    """Sparse projection-free reduction: few coefficients recovered from sampled rows (Eq. 25).

    Where a budget covers the whole dictionary nothing is selected and the support is all of it.
    """

    budgets: dict[str, Budget] = {}
    """Rows and atoms by block pattern, such as `*.elastic`. A block that no pattern names takes all
    atoms of its dictionary and twice as many rows, in addition to the required ones."""
    basis: Annotated[Basis, Slot("basis")] = slot_default("pod")
    """Basis of every elastic and thermal block."""
    bases: dict[str, Annotated[Basis, Slot("basis")]] = {}
    """Other bases by block pattern, such as `*.thermal`."""
    sampler: Annotated[Sampler, Slot("sampler")] = slot_default("lhs")
    """Chooses the rows."""
    preconditioner: Annotated[Preconditioner, Slot("preconditioner")] = slot_default("none")
    """Of the sampled rows of the blocks that `preconditioned` names (Sec. 3.2)."""
    preconditioned: tuple[str, ...] = ("*.thermal",)
    """Blocks whose rows are preconditioned, by pattern; `elastic` is short for `*.elastic`. As
    published only the thermal ones."""
    residual: Residual | dict[str, Residual] = "plain"
    """Which rows are sampled, in all blocks or by block pattern: `plain` those of the residual r as
    published; `preconditioned` those of D^-1 r, the error that r causes, with the operator D of a
    step. Least squares of these come near to Galerkin; a step costs the same."""
    resample: int | None = Field(default=None, ge=1)
    """Steps after which other rows are drawn (the paper: 1); left out: one draw for the run."""
    row_sets: int | None = Field(default=None, ge=2)
    """How many sets of rows are drawn and prepared in advance, to come back in turn; left out:
    every draw is new, and prepared when it is drawn."""
    solver: Annotated[SparseSolver, Slot("sparse_solver")] = slot_default("greedy_gauss_newton")
    """Selects atoms where a budget is smaller than the dictionary."""
    every: int = Field(default=1, ge=1)
    """Steps between selections."""
    carried: bool = True
    """Warm start: each selection starts from the support of the previous step, else from none."""
    polish: bool = True
    """Re-solve each step on the selected support, with the rigid and multiplier rows as exact
    equations. False, as published: the solution of the sparse solver is used, in which those rows
    are part of the least squares; needs a selection in every step, and no radiation."""
    screen: bool = True
    """Screening: skip the sparse solver where an inexpensive test shows that it would keep the
    support; the result is the same. Needs `polish` and `carried`."""
    predictor: int = Field(default=6, ge=1, le=8)
    """Number of past states that the first guess of a step extrapolates."""
    remaining: float = Field(default=1e-13, gt=0, lt=1e-3)
    """Relative error of the unknowns that may remain in a step."""
    max_iterations: int = Field(default=30, ge=1)
    """Newton iterations before a step is given up."""

    @field_validator("preconditioned")
    @classmethod
    def _by_pattern(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(name if "." in name or "*" in name else f"*.{name}" for name in names)

    shared_options: ClassVar[tuple[str, ...]] = (*BASES, "budgets")

    def field_budget(self, field: str) -> BlockBudget | None:
        found = of_field(field, self.budgets)
        return None if found is None else BlockBudget(found.rows, found.atoms)

    def with_rows(self, rows: Mapping[str, int]) -> "Sparse":
        return self.model_copy(update={"budgets": self._varied("rows", rows)})

    def with_atoms(self, atoms: Mapping[str, int]) -> "Sparse":
        basis, bases = counted(atoms, self.basis, self.bases)
        return self.model_copy(update={
            "budgets": self._varied("atoms", atoms), "basis": basis, "bases": bases})

    def _varied(self, option: str, counts: Mapping[str, int]) -> dict[str, Budget]:
        """Budgets by field, with another number each; they are validated with the scene."""
        return {f"*.{field}": (of_field(field, self.budgets) or Budget()).model_copy(
            update={option: n}) for field, n in counts.items()}

    def restart_refusal(self) -> str:
        return "" if self.resample is None else (
            "the rows of this reducer change with the steps, so steps of different size cannot be "
            "compared: keep its rows (leave out reducer.resample), or leave out time.control")

    def preconditions(self, name: str) -> bool:
        """True if the rows of a block are those of D^-1 r."""
        table = {"*": self.residual} if isinstance(self.residual, str) else self.residual
        return chosen(name, table, "plain") == "preconditioned"

    def prepare(self, problem: ReducedProblem) -> StepSolver:
        model, h, offline = problem.model, problem.step, problem.offline
        faults = self.check(model)
        if faults:
            raise InputError(faults).under("reducer")
        budgets = {n: chosen(n, self.budgets, Budget()) for n in model.reducible()}
        step = StepFactors(h, *constants(model.layout, problem.integrator, h))
        dictionaries, limits = trial_bases(
            offline, {n: chosen(n, self.bases, self.basis) for n in model.reducible()}, step)
        streams = dict(zip(budgets, problem.rng.spawn(len(budgets)), strict=True))
        build = Build(model, offline, self, dictionaries, limits,
                      {n: b.atoms for n, b in budgets.items()}, step)

        def draw(streams: Streams, keep: OfflineProducts | None) -> dict[str, IntArray]:
            return {n: choose_rows(model, keep, n, self._rows(model, n, b, dictionaries[n]),
                                   b.atoms or 10**9, self.sampler, dictionaries[n], streams[n],
                                   step, self.preconditions(n))
                    for n, b in budgets.items()}

        later = {n: rng.spawn(1)[0] for n, rng in streams.items()}
        rows = draw(streams, offline)
        build = replace(build, notes=self._idle(model, dictionaries, rows))
        if self.resample is None:
            return build.solver(rows)
        return self._resampled(build, rows, later, draw)

    def _rows(
        self, model: AssembledModel, name: str, budget: Budget, dictionary: Dictionary
    ) -> int:
        """Rows to draw in addition to the required ones."""
        if budget.rows is not None:
            return budget.rows
        return default_rows(model, name, self.sampler, dictionary.atoms.shape[1])

    def _idle(
        self, model: AssembledModel, dictionaries: Mapping[str, Dictionary],
        rows: Mapping[str, IntArray]
    ) -> tuple[Note, ...]:
        """Notes on options that change nothing in this run."""
        atoms = {n: d.atoms.shape[1] for n, d in dictionaries.items()}
        active = {n: (chosen(n, self.budgets, Budget()).atoms or k, k) for n, k in atoms.items()}
        return (
            *unselected(self, active), *shadowed_basis(self, model, self.bases),
            *unread_sampler(self, {n: (len(r), block_size(model, n)) for n, r in rows.items()}),
            *unweighted(self, model, self.preconditioned))

    def _resampled(
        self, build: Build, rows: Mapping[str, IntArray], later: Streams,
        draw: Callable[[Streams, OfflineProducts | None], Mapping[str, IntArray]],
    ) -> StepSolver:
        """The first rows are those of a run without resampling; later: streams of the others."""
        assert self.resample is not None
        whole = Whole.of(build.model, build.dictionaries)
        first = build.solver(rows, whole)
        if self.row_sets is None:
            online = replace(build, offline=None)

            def fresh(rows: Mapping[str, IntArray], number: int) -> StepSolver:
                return online.solver(rows, whole, number)

            return Resampled(
                first, (first,), self.resample, lambda s: draw(s, None), fresh, later)
        others = [build.solver(draw(branched(later), build.offline), whole, i)
                  for i in range(1, self.row_sets)]
        return Resampled(first, (first, *others), self.resample, None, None, {})

    def check(self, model: AssembledModel) -> Sequence[Fault]:
        """Faults found by counting, before any training; keys relative to the reducer."""
        faults = budget_faults(model, self.budgets, self.sampler)
        faults += pattern_faults(model, "bases", self.bases)
        faults += pattern_faults(model, "preconditioned", self.preconditioned)
        faults += preconditioner_faults(
            model, self.budgets, self.sampler, self.preconditioner, self.preconditioned,
            self.basis, self.bases)
        faults += capability_faults(
            model, self.budgets, self.sampler, self.solver, self.basis, self.bases)
        faults += resampling_faults(model, self.resample, self.row_sets)
        faults += self._residual_faults(model)
        faults += coupled_faults(model, self.budgets, self.basis, self.bases, self.resample)
        if not self.polish and self.every > 1:
            faults.append(Fault("every", "without polish each step needs its own selection: "
                                "take every: 1"))
        local = [b.thermal for b in model.separated.heat if b.local]
        if not self.polish and local:
            faults.append(Fault("polish", f"the selection in {', '.join(local)} is linear and "
                                "leaves radiation to the polish: take polish: true"))
        return faults

    def _residual_faults(self, model: AssembledModel) -> list[Fault]:
        """Faults of rows of D^-1 r that would need the whole mesh in a step, or in a draw of
        rows."""
        faults = ([] if isinstance(self.residual, str) else
                  pattern_faults(model, "residual", self.residual))
        inverted = [n for n in model.reducible() if self.preconditions(n)]
        local = local_blocks(model)
        for name in inverted:
            if name in local:
                faults.append(Fault("residual", (
                    f"a row of D^-1 r reads all of r in {name}, and so every element of "
                    f"{local[name]} in each step: take plain rows there, or a reducer that "
                    "evaluates all of them, such as galerkin")))
        if inverted and self.resample is not None and self.row_sets is None:
            faults.append(Fault("row_sets", (
                f"each draw of rows of D^-1 r in {', '.join(inverted)} takes solves with the whole "
                "operator: give a number of row sets, which are prepared in advance")))
        return faults
