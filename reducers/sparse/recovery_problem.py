"""Sparse recovery problems of one step (Eq. 25 of the paper), in the form that sparse solvers take.

Heat: P (B c - b) = 0 with the preconditioner P, linear, one block at a time; local terms
(radiation) enter only the subsequent solve on the selected support. Mechanics: the sampled rows of
all elastic blocks together with the equations of rigid coordinates and multipliers (the border), in
one problem, by the residual of all steps (reduced_equations.py); these unknowns form a group
without a limit on its nonzeros. Elastic rows are scaled by the largest column of their block,
border rows by their own size divided by BORDER, because they are equations that must be satisfied
and not a sample. Sampled rows are compressed by an orthogonal transformation (row_compression.py),
which changes neither norms nor solutions.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sparsemor.core import FloatArray, Group, IntArray, StepFormula
from sparsemor.reducers.sparse.sampled_block import SampledElastic, SampledHeat
from sparsemor.reducers.step.newton_loop import Linearisation
from sparsemor.reducers.step.reduced_equations import Reduced
from sparsemor.reducers.step.time_tables import plus_loads

BORDER = 10.0
"""Length of the scaled rows of rigid coordinates and multipliers; sampled rows have at most 1."""


def shape_needs(rows: int, columns: int) -> frozenset[str]:
    """Capabilities of a sparse solver (`core.protocols.sparse_solver`) that a problem with this
    number of rows and columns requires."""
    if rows == columns:
        return frozenset()
    return frozenset({"overdetermined" if rows > columns else "underdetermined"})


def mechanics_needs(blocks: Sequence[SampledElastic], border: int) -> frozenset[str]:
    """Capabilities that the problem of all elastic blocks with `border` rigid coordinates and
    multipliers requires of its sparse solver."""
    shapes = [s.block.B.shape for s in blocks]
    rows, columns = (sum(shape[i] for shape in shapes) + border for i in (0, 1))
    return shape_needs(rows, columns) | {"nonlinear", "unpenalised"}


@dataclass(frozen=True, slots=True, eq=False)
class HeatProblem:
    """Linear problem J c - b of one thermal block: J (m, k) and b (m,) include the preconditioner
    and are scaled to a largest column norm of 1. groups: the one range of columns, with its largest
    number of nonzeros; needs: capabilities that the problem requires of a sparse solver."""

    groups: tuple[Group, ...]
    J: FloatArray
    b: FloatArray
    needs: frozenset[str]

    @classmethod
    def at(cls, s: SampledHeat, r1: FloatArray, t: float) -> "HeatProblem":
        """Problem of a block at the end t (s) of a step with T' = c1 T + r1, r1 (k,): of C T' + K T
        = loads(t) the rows J = c1 C + K, b = loads(t) - C r1."""
        T, J = s.compressed
        b = plus_loads(T.constant - T.capacity @ r1, T, t)
        size = float(np.linalg.norm(J, axis=0).max())
        group = Group(s.block.name, 0, J.shape[1], s.block.budget)
        return cls((group,), J / size, b / size, shape_needs(*s.block.B.shape))

    def residual(self, c: FloatArray) -> FloatArray:
        return self.J @ c - self.b

    def jacobian(self, c: FloatArray) -> FloatArray:
        return self.J


class MechanicsProblem:
    """Nonlinear least-squares problem of all elastic blocks in a step: unknowns [c of each block |
    rigid coordinates and multipliers], residual and Jacobian dense. residual: of all sampled rows;
    x: state with the temperatures of the step.

    columns, numbers: unknowns and rows of the problem among those of the model; scale: factors of
    the rows; groups: ranges of the blocks, with their budgets of nonzeros, the border last. k:
    number of coefficients, border: number of rigid coordinates and multipliers.
    """

    def __init__(
        self, residual: Reduced, sampled: Sequence[SampledElastic], step: StepFormula,
        x: FloatArray,
    ) -> None:
        """residual: equations of all sampled rows of mechanics; sampled: elastic blocks; x (n,):
        first guess of the unknowns of a step, with its final temperatures. Unknowns `columns` and
        rows `numbers` of the model are those of the problem: all of each elastic block in turn,
        then rigid coordinates and multipliers (the border)."""
        self.rows, self.step, self.x = residual, step, x
        layout, border = residual.layout, residual.border
        groups, columns, rows, scales, k = [], list[IntArray](), list[IntArray](), [], 0
        for s in sampled:  # compressed[1]: operator B of the block in its rows (height, atoms)
            name, (height, atoms) = s.block.name, s.compressed[1].shape
            at, own = layout[name], residual.rows[name]
            columns.append(np.arange(at.start, at.stop))
            rows.append(np.arange(own.start, own.stop))
            size = float(np.linalg.norm(s.compressed[1], axis=0).max())
            scales.append(np.full(height, 1.0 / size))
            groups.append(Group(name, k, k + atoms, s.block.budget))
            k += atoms
        self.k, self.border = k, len(border)
        self.columns = np.concatenate((*columns, border))
        self.numbers = np.concatenate((*rows, residual.border_rows))
        self.groups = (*groups, Group("border", k, k + self.border, None))
        self.needs = mechanics_needs(sampled, self.border)
        self.prescribed = residual.prescribed(step.t)  # terms that depend on time alone
        self.scale = np.concatenate((*scales, np.ones(self.border)))
        self._constant: FloatArray | None = None  # the Jacobian, where it never changes
        if self.border:  # its rows get the length BORDER, sampled ones have at most 1
            size = np.linalg.norm(self.jacobian(self.start())[-self.border :], axis=1)
            self.scale[-self.border :] = BORDER / np.where(size > 0, size, 1.0)

    def start(self) -> FloatArray:
        """Initial guess: the predicted state."""
        return self.x[self.columns]

    def _state(self, c: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Unknowns of the model with their rates (n,) each, at unknowns c of the problem."""
        x = self.x.copy()
        x[self.columns] = c
        return self.step.at(x - self.step.free)

    def residual(self, c: FloatArray) -> FloatArray:
        r = self.rows.residual_at(*self._state(c), self.step.t, self.prescribed)
        return np.asarray(self.scale * r[self.numbers])

    def jacobian(self, c: FloatArray) -> FloatArray:
        """Jacobian (m + border, k + border), of the rows `numbers` of the model times `scale`, by
        its unknowns `columns`; the same array for all c where the motion of all frames is
        prescribed."""
        if self._constant is not None:
            return self._constant
        step = self.step
        J = self.rows.slope_at(Linearisation(
            *self._state(c), step.t, (step.c1, step.c2, step.c1_first, step.c2_first)))
        J = J[np.ix_(self.numbers, self.columns)]
        made: FloatArray = np.multiply(J, self.scale[:, None], order="F")
        if not self.border:
            self._constant = made
        return made
