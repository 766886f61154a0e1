"""Selection of atoms block by block, at the solution of a step.

Rigid coordinates, joint forces and the temperatures that load a body are held at their values in
the step. The sampled rows of each block are then linear in its coefficients with a constant matrix,

    min over d of |r + B d|,   c + d with at most `budget` nonzeros,

whose factors the sparse solver computes once (`SparseSolver.prepare`). The effect of the held
unknowns is of second order: the step is solved again with all of them on the new support.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from sparsemor.core import (
    BoolArray,
    FloatArray,
    InputError,
    Recovery,
    Selection,
    SparseSolver,
    Status,
    StepFormula,
    StepOutcome,
)
from sparsemor.core.linalg.column_subsets import ColumnSubsets
from sparsemor.core.registry.returned_values import checked_return, prepared_recovery
from sparsemor.reducers.sparse.held_rows import ElasticRows, HeldRows, ThermalRows
from sparsemor.reducers.sparse.memory import SparseMemory
from sparsemor.reducers.sparse.supported_steps import (
    Found,
    SelectionFailed,
    Solved,
    SupportedSteps,
    reselected_step,
)

DEPENDENT = 1e-8
"""Distance of a unit column from the span of others below which the rows do not distinguish its
atom from theirs, in the first step."""
ROUND_OFF = 100.0 * float(np.finfo(np.float64).eps)
"""Residual norm, relative to that of the coefficients of unit columns, below which a residual is
zero within rounding of its terms."""


@dataclass(frozen=True, slots=True, eq=False)
class BlockSelection:
    """Constant data of the selection in one block. weight: 1 / length^2 of the longest column of B,
    by which squared residuals of several blocks are made comparable; tolerance: residual norm,
    relative to that of the coefficients of unit columns, up to which no exchange is needed."""

    rows: HeldRows
    weight: float
    recovery: Recovery
    tolerance: float

    @classmethod
    def of(
        cls, rows: HeldRows, solver: SparseSolver, tolerance: float = 0.0
    ) -> "BlockSelection":
        columns = rows.columns
        return cls(rows, float(columns.lengths.max(initial=1e-300)) ** -2,
                   prepared_recovery(solver, columns.unit, rows.budget),
                   max(tolerance, ROUND_OFF))

    @property
    def columns(self) -> ColumnSubsets:
        """Columns of B scaled to unit length."""
        return self.rows.columns.unit

    @property
    def widest(self) -> BoolArray:
        """All atoms that the rows distinguish; none where there are fewer rows than atoms."""
        J = self.columns.A
        m, k = J.shape
        support = np.zeros(k, dtype=np.bool_)
        if k <= m and k:
            R, order = qr(J, mode="r", pivoting=True, check_finite=False)
            kept = np.abs(np.diag(R)) > DEPENDENT
            support[order[: len(kept)][kept]] = True
        return support

    def at(self, r: FloatArray, c: FloatArray, support: BoolArray) -> "AtSolution":
        """The block at coefficients c (k,) with the residual r (l,) of all compressed rows, which
        they minimise on `support`."""
        count = len(self.columns.A)
        near, rest = r[:count], r[count:]
        beyond = self.weight * float(rest.dot(rest))
        now = beyond + self.weight * float(near.dot(near))
        return AtSolution(self, near, self.rows.columns.lengths * c, support, beyond, now)


@dataclass(frozen=True, slots=True, eq=False)
class AtSolution:
    """One block at the solution of a step. near (j,): residual in the rows of B; z (k,):
    coefficients of unit columns; beyond: squared residual of the other rows, on which no
    coefficient acts; now: of all rows."""

    block: BlockSelection
    near: FloatArray
    z: FloatArray
    support: BoolArray
    beyond: float
    now: float

    def selected(self) -> Selection:
        """Support on which the sparse solver would end."""
        found = checked_return(
            self.block.recovery.select(self.near, self.z, self.support), Selection,
            self.block.recovery, "select", "reducer.solver")
        if not found.status.ok or bool((found.support == self.support).all()):
            return Selection(self.support, found.status)
        used, budget = int(np.count_nonzero(found.support)), self.block.rows.budget
        if used > budget:
            raise InputError(f"{type(self.block.recovery).__name__} selected {used} atoms in "
                             f"{self.block.rows.name}, {budget} allowed: report it to the authors "
                             "of that sparse solver", "reducer.solver")
        return found

    def after(self, other: BoolArray) -> float | None:
        """Squared residual after least squares on the support `other`; None where the rows do not
        distinguish its atoms."""
        columns, near = self.block.columns, self.near
        gone = np.flatnonzero(self.support & ~other)
        if len(gone):
            near = near - columns.A[:, gone].dot(self.z[gone])
        left = columns.squared_residual(other, near)
        return None if left is None else self.beyond + self.block.weight * left

    @property
    def floor(self) -> float:
        """Squared residual up to which no exchange is needed."""
        return self.block.weight * self.block.tolerance**2 * float(self.z.dot(self.z))


def exchanged(blocks: Sequence[AtSolution], hysteresis: float) -> Found:
    """Supports that replace those of the blocks: the ones of the sparse solver if together they
    lower the norm of the residual by more than the fraction `hysteresis`."""
    now, share = sum(b.now for b in blocks), (1.0 - hysteresis) ** 2
    if sum(b.beyond for b in blocks) >= share * now or now <= sum(b.floor for b in blocks):
        return {}  # not even all atoms together lower it enough
    found, after = {}, 0.0
    for b in blocks:
        name, new = b.block.rows.name, b.selected()
        if not new.status.ok:
            return SelectionFailed(name, new.status)
        left = b.now if new.support is b.support else b.after(new.support)
        if left is not None and new.support is not b.support:
            found[name] = new.support
        after += b.now if left is None else left
    return found if after < share * now else {}


def chosen(blocks: Sequence[AtSolution]) -> Found:
    """Supports of the sparse solver, whatever the present ones are."""
    found = {}
    for b in blocks:
        name, new = b.block.rows.name, b.selected()
        if not new.status.ok:
            return SelectionFailed(name, new.status)
        if not b.block.columns.independent(new.support):
            return SelectionFailed(name, Status.RANK_DEFICIENT)
        if new.support is not b.support:
            found[name] = new.support
    return found


@dataclass(frozen=True, slots=True, eq=False)
class BlockwiseSelection:
    """Selection in each block on its own. hysteresis: fraction by which other supports must lower
    the residual norm to replace nonempty ones; carried: start from the supports of the previous
    step, otherwise from the empty ones.

    Each thermal block decides on its own. Elastic blocks decide together, as in the joint problem:
    joint forces pass the error of one body on to the others, and an exchange that lowers a residual
    which is small against another body's only adds a jump in velocities.

    A selection without supports to start from, as in the first step, is made at the solution with
    the `widest` supports, all atoms that the rows distinguish: there the held quantities are those
    of the projected model of the whole dictionary. Where that has no solution, or the rows are
    fewer than the atoms, it is made at the solution without atoms, of rigid bodies.
    """

    steps: SupportedSteps
    heat: Sequence[BlockSelection]
    bodies: Sequence[BlockSelection]
    hysteresis: float
    carried: bool
    widest: dict[str, BoolArray]

    @classmethod
    def of(
        cls, steps: SupportedSteps, solver: SparseSolver, hysteresis: float, carried: bool,
        settled: float,
    ) -> "BlockwiseSelection":
        """settled: tolerance of every block."""
        layout, mechanics = steps.base.layout, steps.base.mechanics
        heat: list[HeldRows] = [ThermalRows.of(s, layout[n]) for n, s in steps.heat.items()]
        bodies: list[HeldRows] = [] if mechanics is None else [
            ElasticRows.of(steps.elastic[b.elastic_name], i, b.elastic, b.thermal)
            for i, b in enumerate(mechanics.bodies) if b.elastic_name in steps.elastic]
        hot, bent = ([BlockSelection.of(r, solver, settled) for r in some]
                     for some in (heat, bodies))
        return cls(steps, hot, bent, hysteresis, carried,
                   {b.rows.name: b.widest for b in (*hot, *bent)})

    def solve(self, step: StepFormula, memory: SparseMemory) -> StepOutcome:
        """Solution of a step with a selection in every block."""
        starts = [self.widest, self.steps.empty]
        if self.carried and any(s.any() for s in memory.supports.values()):
            starts.insert(0, memory.supports)
        for start in starts:
            outcome = reselected_step(self.steps, self, step, memory, start)
            if outcome is not None:
                return outcome
        return self.steps.on(memory, starts[0]).tried(step, memory)  # the failure

    def thermal(self, at: Solved, memory: SparseMemory) -> Found:
        changed: dict[str, BoolArray] = {}
        for block in self.heat:
            found = self._exchanged([block], at, memory)
            if isinstance(found, SelectionFailed):
                return found
            changed |= found
        return changed

    def elastic(self, at: Solved, memory: SparseMemory) -> Found:
        return self._exchanged(self.bodies, at, memory)

    def _exchanged(
        self, blocks: Sequence[BlockSelection], at: Solved, memory: SparseMemory
    ) -> Found:
        """Exchanges in blocks that decide together."""
        step, x, supports = at.step, at.outcome.x, at.supports
        parts = [b.at(b.rows.residual(step, x, at.now, memory.work), x[b.rows.at],
                      supports[b.rows.name]) for b in blocks]
        bad = next((p for p in parts if not p.now < np.inf), None)
        if bad is not None:
            return SelectionFailed(bad.block.rows.name, Status.NOT_FINITE)
        return chosen(parts) if at.fresh else exchanged(parts, self.hysteresis)
