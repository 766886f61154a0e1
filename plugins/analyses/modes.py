"""Modes of small vibrations about a state: the constrained quadratic eigenvalue problem

    (lambda^2 M + lambda D + K) phi + G^T mu = 0,    G phi = 0,

with the tangents K, D, M of the model in the axes of the moving bodies and the constraints G of its
joints. Without damping and gyroscopic matrix lambda = i omega, and Lanczos iterations with the
inverse of the bordered matrix (K - shift M, G^T; G, 0) find the lowest omega; else Arnoldi
iterations with that of lambda^2 M + lambda D + K find the lambda of smallest magnitude (Saad 2011,
Numerical Methods for Large Eigenvalue Problems, doi 10.1137/1.9781611970739, Sec. 4.6 and 9.3).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg
from scipy.sparse import block_array, csc_array
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs, eigsh

from sparsemor.core import Csr, FloatArray, InputError, IntArray
from sparsemor.plugins.analyses.analysed_equations import Tangents, stiffness_to_mass
from sparsemor.plugins.analyses.equilibrium import Solver

ComplexArray = NDArray[np.complex128]
DENSE = 200
"""Number of unknowns up to which eigenvalues are those of dense matrices."""
SHIFT = 1e-6
"""Shift relative to the mean ratio of stiffness to mass, over the number of unknowns."""
RIGID = 1e-12
"""Strain energy of a rigid motion relative to the sum of its magnitudes, as by rounding."""
SLOW = 1e-8
"""omega^2 relative to the shift up to which it is rounding, too."""
EXACT = 1e-10
"""Real part of lambda relative to its size that is rounding."""
DAMPED = 1e-11
"""Damping and gyroscopic matrix, relative to sqrt(|K| |M|), below which they are rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Constrained:
    """Tangents of n free unknowns, and the constraints of joints: G (l, n), compliance C (l, l)."""

    K: Csr
    D: Csr
    M: Csr
    G: Csr
    C: Csr

    @classmethod
    def from_tangents(cls, t: Tangents, second: IntArray, held: IntArray) -> "Constrained":
        """Of tangents of all unknowns, `second` those with inertia and `held` the multipliers."""
        K, D, M = (csc_array(X[second][:, second]) for X in (t.K, t.D, t.M))
        return cls(K, D, M, csc_array(t.K[held][:, second]), csc_array(t.K[held][:, held]))

    @property
    def size(self) -> int:
        return int(self.K.shape[0])

    def inverse(self, A: Csr) -> Callable[[FloatArray], FloatArray]:
        """Inverse of A under the constraints: solution y of A y + G^T mu = b, G y + C mu = 0 with
        the compliance C of joints, 0 for most."""
        solve = Solver(block_array([[A, self.G.T], [self.G, self.C]], format="csc"),
                       what="the bordered stiffness matrix")

        def held(b: FloatArray) -> FloatArray:
            whole = np.zeros((len(solve.size), *b.shape[1:]))
            whole[: self.size] = b
            return solve(whole)[: self.size]

        return held

    @property
    def ratio(self) -> float:
        """Mean ratio of stiffness to inertia, 1/s2."""
        return stiffness_to_mass(self.K, self.M)


@dataclass(frozen=True, slots=True, eq=False)
class ComplexModes:
    """Eigenvalues lambda (k,), 1/s, and shapes phi (n, k), of unit phi^H M phi, by increasing
    magnitude; of each conjugate pair the one with positive imaginary part. rigid (k,): True for
    motion without stiffness, whose lambda is 0 but for rounding."""

    values: ComplexArray
    shapes: ComplexArray
    rigid: NDArray[np.bool_]

    @property
    def frequencies(self) -> FloatArray:
        """Frequencies (k,) of the vibrations, Hz; 0 of motions that do not vibrate."""
        return np.asarray(np.abs(self.values.imag) / (2.0 * np.pi))

    @property
    def ratios(self) -> FloatArray:
        """Damping ratios (k,): -Re lambda / |lambda|; 0 of rigid motions, negative for growth."""
        size = np.abs(self.values)
        return np.where(self.rigid | (size == 0.0), 0.0,
                        0.0 - self.values.real / np.where(size > 0.0, size, 1.0))


def modes_of(c: Constrained, count: int) -> ComplexModes:
    """The `count` modes of smallest magnitude, or all. Raises InputError where they do not
    converge."""
    # each constraint without compliance takes one mode
    most = c.size - c.G.shape[0] + int((c.C.diagonal() != 0.0).sum())
    count = min(count, max(most, 0))
    if count == 0:
        raise InputError("nothing can vibrate: every motion is held or prescribed", "count")
    symmetric = abs(c.K - c.K.T).max() <= 1e-8 * abs(c.K).max()
    damped = abs(c.D).max() > DAMPED * np.sqrt(abs(c.K).max() * abs(c.M).max())
    first = _undamped(c, count)
    return _damped(c, count, first) if damped or not symmetric else first


def _undamped(c: Constrained, count: int) -> ComplexModes:
    """Modes of K x = w^2 M x on the constraints, by the inverse of K shifted below 0,

        S M x = x / (w^2 - shift),    S = inverse of K - shift M under the constraints

    dense for small systems, else by Lanczos iteration. Eigenvalues w^2 give lambda = i w, or the
    real sqrt(-w^2) of an unstable state.
    """
    n, shift = c.size, -SHIFT * c.ratio / c.size
    K, M = (csc_array(0.5 * (X + X.T)) for X in (c.K, c.M))
    inverse = c.inverse(csc_array(K - shift * M))
    if n <= DENSE or 3 * count >= n:
        S = inverse(np.eye(n))
        weights, vectors = linalg.eigh(M.toarray())
        # with z = root^T x the matrix root^T S root is symmetric, x = S root z
        root = vectors * np.sqrt(np.maximum(weights, 0.0))  # M = root root^T
        found, inner = linalg.eigh(root.T @ (0.5 * (S + S.T)) @ root)
        order = np.argsort(-np.abs(found))[:count]
        values, shapes = shift + 1.0 / found[order], S @ (root @ inner[:, order])
    else:
        start = inverse(M @ np.random.default_rng([n, count]).standard_normal(n))
        try:
            values, shapes = eigsh(
                K, count, M, sigma=shift, v0=start, tol=0.0,
                OPinv=LinearOperator((n, n), lambda b: inverse(np.ravel(b)), dtype=np.float64))
        except ArpackNoConvergence as error:
            raise _unfinished(len(error.eigenvalues), count) from None
    shapes = shapes / np.sqrt((shapes * (M @ shapes)).sum(axis=0))
    order = np.argsort(np.abs(values))
    values, shapes = values[order], shapes[:, order]
    rigid = _rigid(K, shapes) | (np.abs(values) <= -SLOW * shift)
    values = np.where(rigid, 0.0, values)
    return ComplexModes(np.where(values >= 0.0, 1j, 1.0) * np.sqrt(np.abs(values)),
                 shapes.astype(complex), rigid)


def _unfinished(found: int, count: int) -> InputError:
    """Error for an iteration in which only `found` modes converged."""
    return InputError(f"{found} of {count} modes converged: ask for fewer", "count")


def _rigid(K: Csr, shapes: FloatArray) -> NDArray[np.bool_]:
    """(k,) True for shapes phi (n, k) without strain energy phi^H K phi but for rounding."""
    energy = np.abs((shapes.conj() * (K @ shapes)).sum(axis=0))
    return np.asarray(energy <= RIGID * (np.abs(shapes) * (abs(K) @ np.abs(shapes))).sum(axis=0))


def _damped(c: Constrained, count: int, first: ComplexModes) -> ComplexModes:
    """Modes with damping: of the linear problem in z = (phi, lambda phi), about a real shift s,

        (K + s D + s^2 M) y = -D r1 - M (s r1 + r2),    z = (y, r1 + s y)

    which is z for the right-hand side r = (r1, r2) = z' of the iteration: its eigenvalues are
    1 / (lambda - s). first: modes without damping, from which s and the start of the iteration
    come."""
    n, sizes = c.size, np.abs(first.values[~first.rigid])
    s = 0.1 * float(sizes[0]) if len(sizes) else np.sqrt(SHIFT * c.ratio / n)
    inverse = c.inverse(csc_array(c.K + s * c.D + s * s * c.M))

    def step(r: FloatArray) -> FloatArray:
        r1, r2 = r[:n], r[n:]
        y = inverse(-(c.D @ r1) - c.M @ (s * r1 + r2))
        return np.concatenate([y, r1 + s * y])

    wanted = 2 * (count + int(first.rigid.sum())) + 2  # each with its conjugate, rigid ones twice
    if n <= DENSE or 3 * wanted >= 2 * n:
        found, vectors = linalg.eig(step(np.eye(2 * n)))
    else:
        start = np.concatenate([first.shapes.real.sum(axis=1), s * first.shapes.real.sum(axis=1)])
        try:
            found, vectors = eigs(
                LinearOperator((2 * n, 2 * n), lambda r: step(np.ravel(r)), dtype=np.float64),
                wanted, v0=start, tol=0.0)
        except ArpackNoConvergence as error:
            raise _unfinished(len(error.eigenvalues) // 2, count) from None
    is_finite = np.abs(found) > 1e-13 * np.abs(found).max()  # of constraints: infinite lambda
    values, shapes = s + 1.0 / found[is_finite], vectors[:n, is_finite]
    size = np.sqrt(np.abs((shapes.conj() * (c.M @ shapes)).sum(axis=0)))
    # without infinite lambda of massless unknowns, whose phi^H M phi is rounding
    kept = (size > 1e-9 * np.abs(shapes).max(axis=0)) if len(size) else size > 0.0
    values, shapes = values[kept], shapes[:, kept] / size[kept]
    # lambda = 0 is a double eigenvalue, of large rounding, then rounding of real and imaginary ones
    rigid = np.abs(values) <= np.where(_rigid(c.K, shapes), 1e-3, 1e-5) * s
    values = np.where(rigid, 0.0, values)
    real = np.abs(values.imag) <= 1e-9 * np.abs(values)
    values = np.where(real, values.real, values)
    lasting = np.abs(values.real) <= EXACT * np.abs(values)
    values = np.where(lasting, 1j * values.imag, values)
    order = np.argsort(np.abs(values), kind="stable")
    order = order[(values[order].imag >= 0.0)]
    still = order[rigid[order]][: int(first.rigid.sum())]  # each twice, with a drift in time
    order = np.concatenate([still, order[~rigid[order]]])[:count]
    return ComplexModes(values[order], shapes[:, order], rigid[order])
