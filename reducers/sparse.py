"""The paper's reducer: sampled rows of the full-order equations, sparse coefficients, no
projection."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator

from sparsemor.core.arrays import IntArray
from sparsemor.core.errors import Fault, InputError
from sparsemor.core.model import Model, StepFactors
from sparsemor.core.notes import Note
from sparsemor.core.offline import Offline
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import (
    Basis,
    Dictionary,
    Integrator,
    Preconditioner,
    Sampler,
    SparseSolver,
    StepSolver,
)
from sparsemor.core.slot import Slot, slot_default
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
from sparsemor.reducers.choose import chosen
from sparsemor.reducers.no_effect import (
    shadowed_basis,
    unread_sampler,
    unselected,
    unweighted,
)
from sparsemor.reducers.prepare import constants
from sparsemor.reducers.represent import represent
from sparsemor.reducers.resampled import Resampled, Streams, branched
from sparsemor.reducers.sampled import choose_rows
from sparsemor.reducers.sampled_general import coupled_faults
from sparsemor.reducers.sparse_build import Build, Whole

Residual = Literal["plain", "preconditioned"]


class Budget(Plugin):
    """How much of one block a step may use."""

    rows: int | None = Field(default=None, ge=0)
    """Sampled rows, on top of the required ones; twice the atoms of the dictionary, or as many as
    there are, when not given."""
    atoms: int | None = Field(default=None, ge=1)
    """Most atoms active at once; all of the dictionary when not given."""


class Sparse(Plugin):
    """Each step recovers few coefficients from sampled rows of each block (Eq. 25).

    Where a budget covers the whole dictionary nothing is selected and the support is all of it.
    """

    budgets: dict[str, Budget] = {}
    """Rows and atoms by block pattern, such as `*.elastic`. A block that no pattern names takes all
    atoms of its dictionary and twice as many rows, besides the required ones."""
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
    """How many sets of rows are drawn and prepared beforehand, to come back in turn; left out:
    every draw is new, and prepared when it is drawn."""
    solver: Annotated[SparseSolver, Slot("sparse_solver")] = slot_default("greedy_gauss_newton")
    """Selects atoms where a budget is smaller than the dictionary."""
    every: int = Field(default=1, ge=1)
    """Steps between selections."""
    carried: bool = True
    """Whether a selection starts from the support of the step before, or from none."""
    polish: bool = True
    """Whether a step is solved again on the selected support, with the rigid and multiplier rows
    as exact equations. False, as published: the sparse solver's own solution is taken, in which
    those rows are part of the least squares; needs a selection in every step, and no radiation."""
    screen: bool = True
    """Whether a solver that can tell cheaply that no exchange would pay is asked that first, and
    run in full only where it cannot; the result is the same. Needs polish and a carried support."""
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

    def preconditions(self, name: str) -> bool:
        """Whether the rows of a block are those of D^-1 r."""
        table = {"*": self.residual} if isinstance(self.residual, str) else self.residual
        return chosen(name, table, "plain") == "preconditioned"

    def prepare(
        self, model: Model, integrator: Integrator, h: float,
        offline: Offline, rng: np.random.Generator,
    ) -> StepSolver:
        faults = self.check(model)
        if faults:
            raise InputError(faults).under("reducer")
        budgets = {n: chosen(n, self.budgets, Budget()) for n in model.reducible()}
        step = StepFactors(h, *constants(model.layout, integrator, h))
        dictionaries, limits = represent(
            offline, {n: chosen(n, self.bases, self.basis) for n in model.reducible()}, step)
        streams = dict(zip(budgets, rng.spawn(len(budgets)), strict=True))
        build = Build(model, offline, self, dictionaries, limits,
                      {n: b.atoms for n, b in budgets.items()}, step)

        def draw(streams: Streams, keep: Offline | None) -> dict[str, IntArray]:
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

    def _rows(self, model: Model, name: str, budget: Budget, dictionary: Dictionary) -> int:
        """Rows to draw besides the required ones."""
        if budget.rows is not None:
            return budget.rows
        return default_rows(model, name, self.sampler, dictionary.atoms.shape[1])

    def _idle(
        self, model: Model, dictionaries: Mapping[str, Dictionary], rows: Mapping[str, IntArray]
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
        draw: Callable[[Streams, Offline | None], Mapping[str, IntArray]],
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

    def check(self, model: Model) -> Sequence[Fault]:
        """What can be refused by counting, before any training; keys relative to the reducer."""
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

    def _residual_faults(self, model: Model) -> list[Fault]:
        """Where rows of D^-1 r would need the whole mesh in a step, or in a draw of rows."""
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
                "operator: give a number of row sets, which are prepared beforehand")))
        return faults
