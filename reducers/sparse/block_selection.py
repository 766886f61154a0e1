"""Selection of atoms block by block, at the solution of a step.

Rigid coordinates, joint forces and the temperatures that load a body are fixed at their values in
the step. The sampled rows of each block are then linear in its coefficients with a constant matrix,

    min over d of |r + B d|,   c + d with at most `budget` nonzeros,

whose factors the sparse solver computes once (`SparseSolver.prepare`). The effect of the fixed
unknowns is of second order: the step is solved again with all of them on the new support.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

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
from sparsemor.reducers.sparse.sampled_block import RangeColumns, SampledElastic, SampledHeat
from sparsemor.reducers.sparse.sparse_memory import SparseMemory
from sparsemor.reducers.sparse.supported_steps import (
    AtomSelection,
    SolvedStep,
    SupportedSteps,
    no_selection,
)
from sparsemor.reducers.step.reduced_equations import Reduced

DEPENDENT = 1e-8
"""Distance of a unit column from the span of others below which the rows do not distinguish its
atom from theirs, in the first step."""
ROUND_OFF = 100.0 * float(np.finfo(np.float64).eps)
"""Residual norm, relative to that of the coefficients of unit columns, below which a residual is
zero within rounding of its terms."""


class BlockRows(NamedTuple):
    """One block in the residual of all sampled rows: numbers `at` of its unknowns and `rows` of its
    rows; budget: largest number of active atoms; columns: the operator B (j, k) on its coefficients
    in the first j rows, zero in the others."""

    name: str
    at: slice
    rows: slice
    budget: int
    columns: RangeColumns

    @classmethod
    def from_block(cls, s: SampledHeat | SampledElastic, residual: Reduced) -> "BlockRows":
        name = s.block.name
        return cls(name, residual.layout[name], residual.rows[name], s.block.budget, s.columns)


@dataclass(frozen=True, slots=True, eq=False)
class BlockSelection:
    """Constant data of the selection in one block. weight: 1 / length^2 of the longest column of B,
    by which squared residuals of several blocks are made comparable; tolerance: residual norm,
    relative to that of the coefficients of unit columns, up to which no exchange is needed."""

    rows: BlockRows
    weight: float
    recovery: Recovery
    tolerance: float

    @classmethod
    def from_rows(
        cls, rows: BlockRows, solver: SparseSolver, tolerance: float = 0.0
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
    def distinguishable(self) -> BoolArray:
        """All atoms that the rows distinguish; none where there are fewer rows than atoms.
        columns.unit: True if the columns J = B / (lengths of its columns), (m, k), are the unit
        matrix, where all atoms are distinguished."""
        J = self.columns.A
        m, k = J.shape
        support = np.full(k, self.columns.unit)
        if k <= m and k and not self.columns.unit:
            # pivoted QR: |R_ii| is the distance of column i from the span of those before it
            R, order = qr(J, mode="r", pivoting=True, check_finite=False)
            kept = np.abs(np.diag(R)) > DEPENDENT
            support[order[: len(kept)][kept]] = True
        return support

    def at(self, r: FloatArray, c: FloatArray, support: BoolArray) -> "AtSolution":
        """The block at coefficients c (k,) with the residual r (l,) of all compressed rows, whose
        norm they minimise on `support` (k,). The first j rows are those of B."""
        count = len(self.columns.A)
        in_range, rest = r[:count], r[count:]
        remaining = self.weight * float(rest.dot(rest))
        current = remaining + self.weight * float(in_range.dot(in_range))
        return AtSolution(
            self, in_range, self.rows.columns.lengths * c, support, remaining, current)


@dataclass(frozen=True, slots=True, eq=False)
class AtSolution:
    """One block at the solution of a step on the active atoms `support` (k,). range_residual (j,):
    residual r in the rows of B; z (k,): coefficients c times the lengths of B's columns, so that a
    change d of z changes r by (unit columns) d; remaining: squared residual of the other rows, on
    which no coefficient acts; current: of all rows. Both, and the results of `after` and
    `threshold`, are times `block.weight`, 1 / length^2 of B's longest column."""

    block: BlockSelection
    range_residual: FloatArray
    z: FloatArray
    support: BoolArray
    remaining: float
    current: float

    def selected(self) -> BoolArray:
        """Support on which the sparse solver would end, from the residual in the rows of B (j,),
        the scaled coefficients z (k,) and the present support; this very array where the support
        stays, which callers test by `is`. Raises SolveFailed."""
        found = checked_return(
            self.block.recovery.select(self.range_residual, self.z, self.support), Selection,
            self.block.recovery, "select", "reducer.solver")
        if not found.status.ok:
            raise no_selection(self.block.rows.name, found.status)
        if bool((found.support == self.support).all()):
            return self.support
        used, budget = int(np.count_nonzero(found.support)), self.block.rows.budget
        if used > budget:
            raise InputError(f"{type(self.block.recovery).__name__} selected {used} atoms in "
                             f"{self.block.rows.name}, {budget} allowed: report it to the authors "
                             "of that sparse solver", "reducer.solver")
        return found.support

    def after(self, other: BoolArray) -> float | None:
        """Squared residual after least squares on the support `other`; None where the rows do not
        distinguish its atoms."""
        columns, residual = self.block.columns, self.range_residual
        dropped = np.flatnonzero(self.support & ~other)
        if len(dropped):  # the residual without the atoms that leave the support
            residual = residual - columns.A[:, dropped].dot(self.z[dropped])
        squared = columns.squared_residual(other, residual)
        return None if squared is None else self.remaining + self.block.weight * squared

    @property
    def threshold(self) -> float:
        """Squared residual up to which no exchange is needed."""
        return self.block.weight * self.block.tolerance**2 * float(self.z.dot(self.z))


def exchanged(blocks: Sequence[AtSolution], hysteresis: float) -> dict[str, BoolArray]:
    """Supports that replace those of the blocks, by block: the ones of the sparse solver if
    together they lower the norm of the residual by more than the fraction `hysteresis`, else none.
    Raises SolveFailed."""
    # all sums are of squared residuals
    current, share = sum(b.current for b in blocks), (1.0 - hysteresis) ** 2
    # the remaining residual is a lower bound: not even all atoms together lower it enough
    if sum(b.remaining for b in blocks) >= share * current:
        return {}
    if current <= sum(b.threshold for b in blocks):
        return {}
    found, after = {}, 0.0
    for b in blocks:
        new = b.selected()
        squared = b.current if new is b.support else b.after(new)  # None: not distinguished
        if squared is not None and new is not b.support:
            found[b.block.rows.name] = new
        after += b.current if squared is None else squared
    return found if after < share * current else {}


def chosen(blocks: Sequence[AtSolution]) -> dict[str, BoolArray]:
    """Supports of the sparse solver, by block, whatever the present ones are: those that differ.
    Raises SolveFailed."""
    found = {}
    for b in blocks:
        name, new = b.block.rows.name, b.selected()
        if not b.block.columns.independent(new):
            raise no_selection(name, Status.RANK_DEFICIENT)
        if new is not b.support:
            found[name] = new
    return found


@dataclass(frozen=True, slots=True, eq=False)
class BlockwiseSelection(AtomSelection):
    """Selection in each block on its own. carried: start from the supports of the previous step,
    otherwise from the empty ones.

    Each thermal block decides on its own. Elastic blocks decide together, as in the joint problem:
    joint forces pass the error of one body on to the others, and an exchange that lowers a residual
    which is small against another body's only adds a jump in velocities.

    A selection without supports to start from, as in the first step, is made at the solution with
    the `distinguishable` supports, all atoms that the rows distinguish: there the fixed quantities
    are those of the projected model of the whole dictionary. Where that has no solution, or the
    rows are fewer than the atoms, it is made at the solution without atoms, of rigid bodies.
    """

    heat: Sequence[BlockSelection]
    bodies: Sequence[BlockSelection]
    carried: bool
    distinguishable: dict[str, BoolArray]

    @classmethod
    def from_steps(
        cls, steps: SupportedSteps, solver: SparseSolver, hysteresis: float, carried: bool,
        settled: float,
    ) -> "BlockwiseSelection":
        """hysteresis: fraction by which other supports must lower the residual norm; carried: start
        from the supports of the previous step; settled: residual norm, relative to that of the
        coefficients of unit columns, up to which a block keeps its support."""
        # of the whole model, rows of heat included
        residual = steps.mechanics.sampled.all_rows.rows
        thermal, elastic = ([
            BlockSelection.from_rows(BlockRows.from_block(s, residual), solver, settled)
            for s in blocks.values()] for blocks in (steps.heat, steps.elastic))
        return cls(steps, hysteresis, thermal, elastic, carried,
                   {b.rows.name: b.distinguishable for b in (*thermal, *elastic)})

    def solve(self, step: StepFormula, memory: SparseMemory) -> StepOutcome:
        """Solution of a step from the first supports on which there is one: those of the step
        before, all distinguishable atoms, none."""
        starts = [self.distinguishable, self.steps.empty]
        if self.carried and any(s.any() for s in memory.supports.values()):
            starts.insert(0, memory.supports)
        for start in starts:
            outcome = self.reselected(step, memory, start)
            if outcome is not None:
                return outcome
        return self.steps.on(memory, starts[0]).trial_solution(step, memory)  # the failure

    def thermal(self, at: SolvedStep, memory: SparseMemory) -> dict[str, BoolArray]:
        changed: dict[str, BoolArray] = {}
        for block in self.heat:
            rows = self.steps.rows(at, memory)[block.rows.rows]
            changed |= self._exchanged([block], at, {block.rows.name: rows})
        return changed

    def elastic(self, at: SolvedStep, memory: SparseMemory) -> dict[str, BoolArray]:
        if not self.bodies:
            return {}
        return self._exchanged(self.bodies, at, self.steps.elastic_rows(at, memory))

    def _exchanged(
        self, blocks: Sequence[BlockSelection], at: SolvedStep, rows: Mapping[str, FloatArray]
    ) -> dict[str, BoolArray]:
        """Supports that are exchanged in blocks that decide together; rows: block -> its residual
        (l,) at the solution `at`."""
        x = at.outcome.x
        parts = [b.at(rows[b.rows.name], x[b.rows.at], at.supports[b.rows.name]) for b in blocks]
        bad = next((p for p in parts if not p.current < np.inf), None)
        if bad is not None:
            raise no_selection(bad.block.rows.name, Status.NOT_FINITE)
        return chosen(parts) if at.fresh else exchanged(parts, self.hysteresis)
