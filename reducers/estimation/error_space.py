"""Trial space for the error of one reduced block, and the block's operators in its eigenmodes.

The error e of a reduced run satisfies the linear equations of its block with the residual r of the
reduced states as load, M e'' + C e' + K e = -r. All residuals lie in the span of few columns S: the
operators times the atoms, the loads, and the directions by which frames and temperatures act. The
space spans the atoms, D^-1 S with the operator D of a step, and the same with an operator of slow
changes: a rational Krylov space of two poles (Druskin and Simoncini 2011, doi
10.1016/j.sysconle.2011.04.013). It contains D^-1 r of every residual if S has few columns, and its
most important directions otherwise.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from sparsemor.core import AssembledModel, Csr, FloatArray, OfflineProducts, StepFactors
from sparsemor.core.linalg.dense import svd
from sparsemor.core.model.factorizations import solve_or_fail
from sparsemor.core.protocols.load_tables import LoadTable
from sparsemor.core.protocols.separable import ElasticOperators, HeatBody

COUNT = 100
"""Least number of vectors in addition to the atoms; as many as atoms if these are more."""
COUPLED = 40
"""Number of vectors in addition to the atoms where the errors of all blocks are solved together."""
OVERSAMPLING = 20
"""Number of random combinations of many residual columns, beyond the wanted vectors, that are
solved for."""
SLOW = 1e-3
"""Rate of slow changes relative to that of one step."""
ROUND_OFF = 1e-10
"""Relative singular value below which a direction outside the atoms is round-off."""
PROPORTIONAL = 1e-8
"""Relative size of damping that couples eigenmodes below which it is round-off."""


@dataclass(frozen=True, slots=True, eq=False)
class Operators:
    """Constant operators (n, n) of one block: stiffness K, damping C, mass M; of heat conductivity
    and capacity, and no mass. damping_force: of displacements, with what is not sparse."""

    stiffness: Csr
    damping: Csr
    mass: Csr | None
    damping_force: Callable[[FloatArray], FloatArray] | None = None

    @classmethod
    def from_body(cls, source: HeatBody | ElasticOperators) -> "Operators":
        if isinstance(source, HeatBody):
            return cls(source.conductivity, source.capacity, None)
        return cls(source.stiffness, source.damping, source.mass, source.damping_force)

    @property
    def numbers(self) -> tuple[FloatArray, ...]:
        """Entries of all operators, which identify them in a cache."""
        found = (self.stiffness, self.damping, self.mass)
        return tuple(A.data for A in found if A is not None)

    def shifted(self, step: StepFactors, slowness: float) -> Csr:
        """K + c1 C + c2 M with the factors of a step that is longer by 1 / slowness."""
        if self.mass is None:
            return self.stiffness + slowness * step.c1_first * self.damping
        return (self.stiffness + slowness * step.c1 * self.damping
                + slowness**2 * step.c2 * self.mass)


@dataclass(frozen=True, slots=True, eq=False)
class ErrorSpace:
    """Space of the errors of one block in eigenmodes of the projected stiffness and mass (heat:
    conductivity and capacity).

    modes (n, q); momenta (q, n): the modes times the mass (heat: the capacity), a left inverse of
    the modes; norm (q, q): |modes x| = |norm x|; stiffness, damping, mass (q,): diagonals of the
    projected operators; coupled: relative size of the damping between modes, which is left out.
    """

    modes: FloatArray
    momenta: FloatArray
    norm: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    mass: FloatArray
    coupled: float

    @property
    def size(self) -> int:
        return int(self.modes.shape[1])

    def coefficients(self, x: FloatArray) -> FloatArray:
        """Coefficients (q,) of the projection of x (n,) on the space, orthogonal in the norm of the
        mass: the projection of accelerations satisfies the projected equations of motion."""
        return self.momenta @ x


def error_space(
    name: str, model: AssembledModel, operators: Operators, atoms: FloatArray,
    sources: Sequence[FloatArray], starts: FloatArray, step: StepFactors,
    offline: OfflineProducts, coupled: bool
) -> ErrorSpace:
    """Space of the errors of a block with trial basis `atoms` (n, k). coupled: True if the errors
    of all blocks are solved together.

    sources: columns (n, j) that span its residuals; starts (n, j): errors of the initial state,
    which the space contains. Raises SolveFailed where an operator cannot be factorized.
    """
    # count: number of vectors in addition to the atoms
    S, count = unit(np.hstack(sources)), COUPLED if coupled else max(COUNT, atoms.shape[1])

    def make() -> dict[str, FloatArray]:
        return {"vectors": _vectors(name, model, operators, atoms, S, starts, step, count)}

    depends = (name, *operators.numbers, atoms, S, starts, tuple(step), count)
    found = offline.remember("error_space", depends, make)["vectors"]
    return in_modes(np.asarray(found), operators)


def _vectors(
    name: str, model: AssembledModel, operators: Operators, atoms: FloatArray, S: FloatArray,
    starts: FloatArray, step: StepFactors, count: int
) -> FloatArray:
    """Orthonormal vectors (n, q): the span of the atoms first, then that of the starts, then at
    most `count` others, responses D^-1 S to the columns S (n, j) that span the residuals."""
    combinations = S.shape[1], count + OVERSAMPLING  # many columns, in few combinations
    if combinations[0] > combinations[1]:  # the range of random combinations, Halko et al. 2011
        S = unit(S @ np.random.default_rng(combinations[0]).standard_normal(combinations))
    # D^-1 S of a step, and of slow changes
    responses = [unit(solve_or_fail(
        model.factorize(name, operators.shifted(step, slow), "error estimate"), S, name))
        for slow in (1.0, SLOW)]
    Q = np.linalg.qr(np.hstack([atoms, _outside(np.linalg.qr(atoms)[0], starts)]))[0]
    X = np.hstack(responses)
    for _ in range(2):  # the second pass removes what rounding left of the first
        X = X - Q @ (Q.T @ X)
    U, s, _ = svd(X)
    significant = s > ROUND_OFF * max(float(s[0]), ROUND_OFF) if len(s) else np.zeros(0, dtype=bool)
    most = min(count, len(Q) - Q.shape[1])
    return np.asarray(np.linalg.qr(np.hstack([Q, U[:, significant][:, :most]]))[0])


def _outside(Q: FloatArray, A: FloatArray) -> FloatArray:
    """Columns of A, of unit length, that are not in the span of the orthonormal Q up to
    round-off."""
    A = unit(A)
    rest = A - Q @ (Q.T @ A)
    return unit(rest[:, np.linalg.norm(rest, axis=0) > ROUND_OFF])


def in_modes(E: FloatArray, operators: Operators) -> ErrorSpace:
    """The span of orthonormal vectors E (n, q) in the eigenmodes E W of its projected operators,
    K against M (heat: conductivity against capacity), with mass or capacity 1."""
    heat = operators.mass is None
    inertia = operators.damping if operators.mass is None else operators.mass
    values, W = linalg.eigh(projected(operators.stiffness, E), projected(inertia, E))
    modes, one, zero = E @ W, np.ones(len(values)), np.zeros(len(values))
    momenta = np.ascontiguousarray((inertia @ modes).T)
    stiffness = np.maximum(values, 0.0)  # below 0 by round-off only
    if heat:
        return ErrorSpace(modes, momenta, norm=W, stiffness=stiffness, damping=one, mass=zero,
                          coupled=0.0)
    assert operators.damping_force is not None
    C = modes.T @ operators.damping_force(modes)
    C = 0.5 * (C + C.T)
    damping = np.diagonal(C).copy()
    sizes = np.sqrt(np.abs(np.outer(damping, damping)))
    between = float(np.abs(C - np.diag(damping)).max(initial=0.0))
    coupled = between / max(float(sizes.max(initial=0.0)), 1e-300)
    return ErrorSpace(modes, momenta, norm=W, stiffness=stiffness, damping=damping, mass=one,
                      coupled=coupled)


def residual_columns(
    source: HeatBody | ElasticOperators, atoms: FloatArray, offset: FloatArray, heat: FloatArray
) -> list[FloatArray]:
    """Columns (n, j) whose span contains the residual of a block at every reduced state. heat
    (nT, j): vectors that span the body's temperatures and their errors."""
    basis = np.column_stack([atoms, offset])
    if isinstance(source, HeatBody):
        found = [source.conductivity @ basis, source.capacity @ atoms]
    else:
        found = [source.stiffness @ basis, source.damping_force(atoms), source.mass @ atoms,
                 *(M @ basis for M in source.generators), source.directions]
        if source.coupling is not None:
            found.append(source.coupling @ heat)
    return [*(np.asarray(A) for A in found), source.loads, source.constant[:, None],
            *(moving_columns(t) for t in source.tables)]


def moving_columns(load: LoadTable) -> FloatArray:
    """Columns (n, j) that span a moving load at all tabulated times."""
    _, s, Vt = svd(load.table.values)
    return np.asarray(load.columns @ Vt[s > ROUND_OFF * s[0]].T)


def unit(A: FloatArray) -> FloatArray:
    """Nonzero columns of A, scaled to unit length."""
    sizes = np.linalg.norm(A, axis=0)
    return np.asarray(A[:, sizes > 0.0] / sizes[sizes > 0.0])


def projected(K: Csr, E: FloatArray) -> FloatArray:
    """Projection E^T K E (q, q) of a symmetric K, exactly symmetric."""
    small = E.T @ (K @ E)
    return np.asarray(0.5 * (small + small.T))
