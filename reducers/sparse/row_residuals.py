"""Residual of one block's sampled rows at the solution of a step, as a function of the block's own
coefficients alone.

Rigid coordinates, joint forces and temperatures of the step are fixed, so that the residual is
linear with a constant matrix, r(c + d) = r + B d, and B vanishes in all compressed rows but the
first (row_compression.py).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sparsemor.core import Amplitude, FloatArray, ReducedTerm, StepFormula, Table
from sparsemor.core.protocols.integrator import second_difference
from sparsemor.core.protocols.load_tables import total_load
from sparsemor.core.protocols.separable import evaluate_amplitudes
from sparsemor.reducers.linalg.active_columns import ActiveColumns
from sparsemor.reducers.sparse.sampled_block import RangeColumns, SampledElastic, SampledHeat
from sparsemor.reducers.step.condensed_newton import Mechanics
from sparsemor.reducers.step.iteration_state import Workspace
from sparsemor.reducers.step.solver import Stepper

ONE = np.ones(1)


class RowResidual(Protocol):
    """Compressed sampled rows of one block; at: its unknowns; columns: the operator B (j, k) on its
    coefficients, without the rows in which it is zero."""

    @property
    def name(self) -> str: ...
    @property
    def at(self) -> slice: ...
    @property
    def budget(self) -> int: ...
    @property
    def columns(self) -> RangeColumns: ...
    def residual(
        self, step: StepFormula, x: FloatArray, now: Stepper, work: Workspace
    ) -> FloatArray:
        """Residual (l,) of the rows at the solution x of a step that `now` has just solved with the
        working arrays `work`; the first j rows are those of B."""
        ...


class SplitRows:
    """Matrix (l, j) of compressed rows whose last columns vanish below the first rows: `upper` (i,
    j) and `lower` (l - i, lower_columns), without these zeros. Inputs of atoms that are not active
    are zero, and their columns are not read."""

    def __init__(self, upper: FloatArray, lower: FloatArray) -> None:
        self.upper, self.lower = ActiveColumns(upper), ActiveColumns(lower)
        self.rows, self.lower_columns = len(upper) + len(lower), lower.shape[1]

    @classmethod
    def of(
        cls, all_rows: Sequence[FloatArray], upper_rows: Sequence[FloatArray], first: int
    ) -> "SplitRows":
        left, right = np.hstack(all_rows), np.hstack(upper_rows)
        return cls(np.hstack([left[:first], right[:first]]), left[first:])

    def times(self, u: FloatArray) -> FloatArray:
        """Product (l,) with u (j,)."""
        upper = self.upper.times(u)
        if len(upper) == self.rows:
            return upper
        return np.concatenate((upper, self.lower.times(u[: self.lower_columns])))


@dataclass(frozen=True, slots=True, eq=False)
class ThermalRows:
    """Rows of a thermal block that multiply [r1, amplitudes of loads, 1, c], and its local terms
    (radiation), which are held at their values in the step; rows: see `SplitRows`."""

    name: str
    at: slice
    budget: int
    columns: RangeColumns
    rows: "SplitRows"
    amplitudes: Sequence[Amplitude]
    tables: tuple[Table, ...]
    local: tuple[ReducedTerm, ...]
    c1: float

    @classmethod
    def of(cls, s: SampledHeat, at: slice) -> "ThermalRows":
        T, B = s.compressed
        rows = SplitRows.of([T.capacity, -T.loads, -T.constant[:, None]], [B], len(s.columns.B))
        return cls(s.block.name, at, s.block.budget, s.columns, rows, T.amplitudes, T.tables,
                   tuple(s.local_rows()), s.c1)

    def residual(
        self, step: StepFormula, x: FloatArray, now: Stepper, work: Workspace
    ) -> FloatArray:
        c, r1, t = x[self.at], -step.c1_first * step.free[self.at], step.t
        loads = evaluate_amplitudes(self.amplitudes, t)
        r = self.rows.times(np.concatenate((r1, loads, ONE, c)))
        if self.tables:
            r -= total_load(self.tables, t)
        if self.local:
            v = self.c1 * c + r1
            bend = np.zeros(len(c)) if step.before is None else (
                second_difference(step.before[self.at], c, v, step.h))
            for term in self.local:
                r += term.residual(c, v, bend, t)
        return r


@dataclass(frozen=True, slots=True, eq=False)
class ElasticRows:
    """Rows of an elastic block that multiply [G, r1, temperatures, amplitudes of loads, 1,
    sigma, c], with the factors sigma of the frame directions and G = sum_g M_g (kappa_g c + mu_g
    r1) split by the matrices M_g of the frame's rotation (elastic_block.py).

    rows: see `SplitRows`; number: position of the body in the mechanical equations; generators:
    number of the M_g, 0 for a frame that does not rotate; damped: r1 is part of the inputs.
    """

    name: str
    at: slice
    budget: int
    columns: RangeColumns
    rows: "SplitRows"
    amplitudes: Sequence[Amplitude]
    tables: tuple[Table, ...]
    number: int
    thermal: slice
    generators: int
    damped: bool

    @classmethod
    def of(cls, s: SampledElastic, number: int, at: slice, thermal: slice) -> "ElasticRows":
        T, B = s.compressed
        g, damped = len(T.generators), bool(T.damping.any())
        rows = SplitRows.of([
            *(T.generators if g else [T.mass]), *([T.damping] if damped else []), -T.coupling,
            -T.loads, T.constant[:, None]], [T.directions, B], s.first)
        return cls(s.block.name, at, s.block.budget, s.columns, rows, T.amplitudes, T.tables,
                   number, thermal, g, damped)

    def residual(
        self, step: StepFormula, x: FloatArray, now: Stepper, work: Workspace
    ) -> FloatArray:
        assert now.mechanics is not None
        sigma, coefficients = self._frame(now.mechanics, work)
        c, free = x[self.at], step.free[self.at]
        r1, inertia = step.free_rate[self.at] - step.c1 * free, -step.c2 * free
        if self.generators:
            kappa, mu = coefficients[:-1].reshape(2, -1)
            turned = np.array((kappa + step.c1 * mu, mu)).T.dot(np.array((c, r1)))
            turned[0] += inertia
            inertia = turned.ravel()
        parts = [inertia, r1] if self.damped else [inertia]
        r = self.rows.times(np.concatenate((
            *parts, x[self.thermal], evaluate_amplitudes(self.amplitudes, step.t), ONE, sigma, c)))
        return np.asarray(r - total_load(self.tables, step.t) if self.tables else r)

    def _frame(self, mechanics: Mechanics, work: Workspace) -> tuple[FloatArray, FloatArray]:
        """Factors sigma (p,), and kappa and mu, of the body's frame at the solution."""
        w, loop = work.frames[self.number], work.loop
        assert loop is not None
        sigma = w.sigma[-1]
        if mechanics.size:  # otherwise that of the frame's own motion
            moved = mechanics.system.stacked(loop.dy)[mechanics.at[self.number]]
            sigma = sigma - moved.dot(w.sigma[:-1])
        return sigma, w.coefficients
