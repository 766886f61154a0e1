"""Terms with constant matrices: elasticity, heat conduction, and given right-hand sides."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import csr_array, hstack

from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.model.frame_term import numbers
from sparsemor.core.protocols import Trial
from sparsemor.core.protocols.contributions import (
    NO_NUMBERS,
    ConstraintRecord,
    MatrixRecord,
    VectorRecord,
)
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.protocols.prescribed_quantities import Held, derivatives
from sparsemor.core.protocols.separable import Amplitude, evaluate_amplitudes


@dataclass(frozen=True, slots=True, eq=False)
class LinearEquations:
    """r = A x + B v + M a - constant - loads @ amplitudes(t); A, B, M (m, n), loads (m, j); M None
    where there is no inertia."""

    A: Any
    B: Any
    constant: FloatArray
    loads: FloatArray
    amplitudes: tuple[Amplitude, ...] = ()
    M: Any = None

    @property
    def elements(self) -> int:
        return 0

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        r = self.A @ x + self.B @ v - self.constant
        if self.M is not None:
            r = r + self.M @ a
        if self.amplitudes:
            r = r - self.loads @ evaluate_amplitudes(self.amplitudes, t)
        return np.asarray(r, dtype=np.float64)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Any:
        J = self.A + self.B * c1[None, :]
        return J if self.M is None else J + self.M * c2[None, :]


@dataclass(frozen=True, slots=True, eq=False)
class LinearTerm:
    """Linear equations at global `rows` and `columns`; assembled once, so no element is visited.

    `source`: the part of the scene that it comes from.
    """

    rows: IntArray
    columns: IntArray
    equations: LinearEquations
    elements: int = 0
    source: str = ""
    linear: ClassVar[bool] = True

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return self.equations.residual(x, v, a, t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        return csr_array(self.equations.jacobian(x, v, a, t, c1, c2))

    def time_derivative(self, order: int, t: float, h: float) -> "LinearTerm | None":
        e = self.equations
        if not e.amplitudes:
            return None
        held = tuple(Held(derivatives(f, t, h)[order - 1]) for f in e.amplitudes)
        of_time = LinearEquations(
            0.0 * e.A, 0.0 * e.B, 0.0 * e.constant, e.loads, held,
            None if e.M is None else 0.0 * e.M)
        return replace(self, equations=of_time)

    def restrict(self, keep: IntArray) -> "LinearTerm":
        e = self.equations
        kept = LinearEquations(
            e.A[keep], e.B[keep], e.constant[keep], e.loads[keep], e.amplitudes,
            None if e.M is None else e.M[keep])
        return replace(self, rows=self.rows[keep], equations=kept)

    def compress(self, trial: Trial, left: FloatArray) -> LinearEquations:
        e, T = self.equations, trial.atoms
        return LinearEquations(
            left @ np.asarray(e.A @ T), left @ np.asarray(e.B @ T),
            left @ (e.constant - e.A @ trial.offset), left @ e.loads, e.amplitudes,
            None if e.M is None else left @ np.asarray(e.M @ T),
        )


def matrix_term(
    layout: Layout, matrices: Sequence[MatrixRecord], vectors: Sequence[VectorRecord]
) -> LinearTerm:
    """A x + B v + M a - (sum of w f(t)) of the records of one part on one block, all its rows.

    One term, so that large parts which cancel (thermal forces of a uniform temperature and of the
    one without stress, 1e5 N at a node) do so before anything is added to them.
    """
    rows = numbers(layout, matrices[0].rows)
    blocks = sorted({m.columns for m in matrices}, key=lambda name: layout[name].start)
    of = {name: numbers(layout, name) for name in blocks}

    def whole(which: str) -> Csr | None:
        parts = {name: csr_array((len(rows), len(at))) for name, at in of.items()}
        given = [(m.columns, X) for m in matrices
                 if (X := {"A": m.A, "B": m.B, "M": m.M}[which]) is not None]
        for name, X in given:
            parts[name] = parts[name] + X
        return csr_array(hstack(list(parts.values()), format="csr")) if given else None

    A, B = (csr_array((len(rows), sum(map(len, of.values())))) if X is None else X
            for X in (whole("A"), whole("B")))
    constant, loads, amplitudes = _right_hand_side(vectors, len(rows))
    return LinearTerm(rows, np.concatenate(list(of.values())), LinearEquations(
        A, B, constant, loads, amplitudes, whole("M")), source=matrices[0].origin.part)


def vector_term(layout: Layout, records: Sequence[VectorRecord]) -> LinearTerm:
    """-(sum of w f(t)) of the records on one block, in the rows where any of them is not zero."""
    used = np.flatnonzero(np.any([r.w != 0 for r in records], axis=0))
    rows, none = numbers(layout, records[0].rows)[used], np.zeros((len(used), 0))
    constant, loads, amplitudes = _right_hand_side(records, len(records[0].w))
    return LinearTerm(rows, NO_NUMBERS, LinearEquations(
        none, none, constant[used], loads[used], amplitudes), source=records[0].origin.part)


def _right_hand_side(
    records: Sequence[VectorRecord], n: int
) -> tuple[FloatArray, FloatArray, tuple[Amplitude, ...]]:
    """Constant (n,), loads (n, j) and their amplitudes."""
    timed = [(r.w, r.amplitude) for r in records if r.amplitude is not None]
    constant = np.zeros(n)
    for r in records:
        if r.amplitude is None:
            constant += r.w
    loads = np.stack([w for w, _ in timed], axis=1) if timed else np.zeros((n, 0))
    return constant, loads, tuple(f for _, f in timed)


def target_term(layout: Layout, record: ConstraintRecord) -> LinearTerm:
    """-targets(t) in the rows of a block of multipliers."""
    rows = numbers(layout, record.block)
    n = len(rows)
    none = np.zeros((n, 0))
    return LinearTerm(rows, NO_NUMBERS, LinearEquations(
        none, none, np.zeros(n), np.eye(n), record.targets), source=record.origin.part)
