"""Linear equations with constant matrices, and loads that are functions or tables of time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.sparse import csr_array, hstack

from sparsemor.core.arrays import Csr, FloatArray, IntArray, Matrix
from sparsemor.core.model.equations import AssembledTerm
from sparsemor.core.protocols.contributions import (
    NO_NUMBERS,
    ConstraintRecord,
    MatrixRecord,
    TableRecord,
    VectorRecord,
)
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.protocols.load_tables import LoadTable, Table
from sparsemor.core.protocols.separable import Amplitude, evaluate_amplitudes
from sparsemor.core.protocols.term import ReducedTerm, Trial
from sparsemor.core.protocols.time_function import Held, derivative_from_right, time_derivatives


@dataclass(frozen=True, slots=True, eq=False)
class LinearEquations(ReducedTerm):
    """Residual r = A x + B v + M a - constant - loads @ amplitudes(t); A, B, M (m, n), loads (m,
    j). M is None for equations without inertia."""

    A: Matrix
    B: Matrix
    constant: FloatArray
    loads: FloatArray
    amplitudes: tuple[Amplitude, ...] = ()
    M: Matrix = None
    linear: ClassVar[bool] = True

    @classmethod
    def of_time(
        cls, constant: FloatArray, loads: FloatArray, amplitudes: tuple[Amplitude, ...]
    ) -> LinearEquations:
        """Equations without unknowns: r = -constant - loads @ amplitudes(t)."""
        none = np.zeros((len(constant), 0))
        return cls(none, none, constant, loads, amplitudes)

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        r = self.A @ x + self.B @ v - self.constant
        if self.M is not None:
            r = r + self.M @ a
        if self.amplitudes:
            r = r - self.loads @ evaluate_amplitudes(self.amplitudes, t)
        return np.asarray(r, dtype=np.float64)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Matrix:
        J = self.A + self.B * c1[None, :]
        return J if self.M is None else J + self.M * c2[None, :]

    def time_derivative(self, order: int, t: float, h: float) -> LinearEquations | None:
        if not self.amplitudes:
            return None
        held = tuple(Held(time_derivatives(f, t, h)[order - 1]) for f in self.amplitudes)
        return LinearEquations(
            0.0 * self.A, 0.0 * self.B, 0.0 * self.constant, self.loads, held,
            None if self.M is None else 0.0 * self.M)

    def restricted(self, keep: IntArray) -> LinearEquations:
        return LinearEquations(
            self.A[keep], self.B[keep], self.constant[keep], self.loads[keep], self.amplitudes,
            None if self.M is None else self.M[keep])

    def mapped(self, trial: Trial, left: FloatArray) -> LinearEquations:
        T = trial.atoms
        return LinearEquations(
            left @ np.asarray(self.A @ T), left @ np.asarray(self.B @ T),
            left @ (self.constant - self.A @ trial.offset), left @ self.loads, self.amplitudes,
            None if self.M is None else left @ np.asarray(self.M @ T))


@dataclass(frozen=True, slots=True, eq=False)
class TabledRows(ReducedTerm):
    """Projected time-tabulated load: residual r = -table(t) of l equations in k reduced unknowns,
    none of which enters; table: values (T, l) at T times."""

    table: Table
    k: int

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return -self.table.at(t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        return np.zeros((self.table.values.shape[1], self.k))


@dataclass(frozen=True, slots=True, eq=False)
class TabledEquations:
    """Time-tabulated load that moves over a body: residual r = -load(t), load.columns (m, j); no
    unknown enters."""

    load: LoadTable
    linear: ClassVar[bool] = False

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return -self.load.at(t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        return np.zeros((self.load.columns.shape[0], 0))

    def time_derivative(self, order: int, t: float, h: float) -> LinearEquations:
        f = derivative_from_right(self.load.at, order, t, h)  # of the load; `of_time` has r = -f
        return LinearEquations.of_time(f, np.zeros((len(f), 0)), ())

    def restricted(self, keep: IntArray) -> TabledEquations:
        return TabledEquations(replace(self.load, columns=csr_array(self.load.columns[keep])))

    def mapped(self, trial: Trial, left: FloatArray) -> TabledRows:
        return TabledRows(self.load.projected(left), trial.atoms.shape[1])


Linear = AssembledTerm[LinearEquations]


def matrix_term(
    layout: Layout, matrices: Sequence[MatrixRecord], vectors: Sequence[VectorRecord]
) -> Linear:
    """Linear residual term A x + B v + M a - (sum of w f(t)): all contributions of one body, joint,
    contact or load to one block of unknowns.

    Summing them first lets large parts cancel exactly, such as the thermal forces of a uniform
    temperature and of the stress-free temperature (1e5 N per node).
    """
    rows = layout.numbers(matrices[0].rows)
    blocks = sorted({m.columns for m in matrices}, key=lambda name: layout[name].start)
    of = {name: layout.numbers(name) for name in blocks}

    def whole(which: str) -> Csr | None:
        """Sum of all matrices A, B or M, with the columns of the blocks side by side; None if no
        record has one."""
        parts = {name: csr_array((len(rows), len(at))) for name, at in of.items()}
        given = [(m.columns, X) for m in matrices
                 if (X := {"A": m.A, "B": m.B, "M": m.M}[which]) is not None]
        for name, X in given:
            parts[name] = parts[name] + X
        return csr_array(hstack(list(parts.values()), format="csr")) if given else None

    A, B = (csr_array((len(rows), sum(map(len, of.values())))) if X is None else X
            for X in (whole("A"), whole("B")))
    constant, loads, amplitudes = right_hand_side(vectors, len(rows))
    return AssembledTerm(rows, np.concatenate(list(of.values())), LinearEquations(
        A, B, constant, loads, amplitudes, whole("M")), matrices[0].origin.part)


def vector_term(layout: Layout, records: Sequence[VectorRecord]) -> Linear:
    """Load term -(sum of w f(t)) on one block of unknowns, in the rows where some load vector w is
    not zero."""
    used = np.flatnonzero(np.any([r.w != 0 for r in records], axis=0))
    whole = LinearEquations.of_time(*right_hand_side(records, len(records[0].w)))
    return AssembledTerm(layout.numbers(records[0].rows)[used], NO_NUMBERS,
                         whole.restricted(used), records[0].origin.part)


def target_term(layout: Layout, record: ConstraintRecord) -> Linear:
    """Prescribed values of constraints: the residual -targets(t) in the rows of a joint's
    multipliers."""
    rows = layout.numbers(record.block)
    equations = LinearEquations.of_time(np.zeros(len(rows)), np.eye(len(rows)), record.targets)
    return AssembledTerm(rows, NO_NUMBERS, equations, record.origin.part)


def table_term(layout: Layout, record: TableRecord) -> AssembledTerm[TabledEquations]:
    """Residual term of a time-tabulated load, in the rows that it acts on."""
    used = np.flatnonzero(np.diff(record.load.columns.indptr))
    return AssembledTerm(layout.numbers(record.rows)[used], NO_NUMBERS,
                         TabledEquations(record.load).restricted(used), record.origin.part)


def right_hand_side(
    records: Sequence[VectorRecord], n: int
) -> tuple[FloatArray, FloatArray, tuple[Amplitude, ...]]:
    """Sum of the constant load vectors (n,), the time-dependent ones as columns (n, j), and their
    amplitudes."""
    timed = [(r.w, r.amplitude) for r in records if r.amplitude is not None]
    constant = sum((r.w for r in records if r.amplitude is None), np.zeros(n))
    loads = np.stack([w for w, _ in timed], axis=1) if timed else np.zeros((n, 0))
    return constant, loads, tuple(f for _, f in timed)
