"""Moments of a body's mass distribution, and the constant tensors that turn them into inertia.

The inertia of z = X + u needs T = sum m z y^T for y = z, u', u''. A set of d x d matrices B_g that
spans the required part of T gives the matrices M_g = m (x) B_g of the elastic inertia
(equations.md, section 1) and the numbers N_g = z.M_g y = B_g : T.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from sparsemor.bodies.frames.rotation import GENERATORS, LEVI_CIVITA
from sparsemor.core import Csr, FloatArray
from sparsemor.core.protocols.poses import FREE_POSE, PLANAR_POSE, SPINNING_POSE

Rates = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class MassProperties:
    """Mass distribution about the frame origin: mass, kg; moment (d,) = sum m X, kg m; second (d,
    d) = sum m X X^T, kg m^2."""

    mass: float
    moment: FloatArray
    second: FloatArray

    @classmethod
    def rigid(cls, mass: float, center: FloatArray, inertia: float | FloatArray) -> Self:
        """Mass distribution of a rigid body.

        center (d,): centre of mass, m; inertia: about it, kg m^2, the moment of inertia in the
        plane, the tensor (3, 3) in space. In the plane the moment of inertia determines only the
        trace of the second moment.
        """
        J = np.asarray(inertia, dtype=np.float64)
        own = 0.5 * J * np.eye(2) if J.ndim == 0 else 0.5 * np.trace(J) * np.eye(3) - J
        return cls(mass, mass * center, own + mass * np.outer(center, center))

    @classmethod
    def of_mesh(cls, m: Csr, X: FloatArray) -> Self:
        """Mass distribution from a mass matrix m (N, N), kg, and reference points X (N, d), m."""
        weights = np.asarray(m.sum(axis=1)).ravel()
        return cls(float(weights.sum()), weights @ X, X.T @ (m @ X))


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Basis of g matrices B (g, d, d) for second moments, the identity first, and the tensors of
    the inertia in it.

    r = 1 in the plane and 3 in space. M_g^T = signs_g M_g; N_g(z) changes by symmetric_g (M_g
    z).dz; names: description of the load M_g X, "" for none. tensor (r, r, g): moments of inertia J
    = tensor N(z); levers (r, g, r): the same tensor transposed; axial (r, g): sum z x m y = axial
    N(y). factors(w, al) (g,): sum_g factor_g B_g = w~ w~ + al~ in body axes, (T, g) for rates (T,
    r); slopes(w) (g, r): their derivative by w; turn (g, r): by al.
    """

    B: FloatArray
    signs: FloatArray
    symmetric: FloatArray
    tensor: FloatArray
    levers: FloatArray
    axial: FloatArray
    factors: Rates
    slopes: Callable[[FloatArray], FloatArray]
    turn: FloatArray
    names: tuple[str, ...]

    @property
    def count(self) -> int:
        return len(self.B)

    def numbers(self, T: FloatArray) -> FloatArray:
        """(g,) components N_g = B_g : T of a second moment T (d, d) = sum m z y^T."""
        return np.asarray(np.tensordot(self.B, T, 2))

    def parts(self) -> tuple[int]:
        """What a stored model keeps: the number of rigid coordinates, which determines the rest."""
        return next((size,) for size, known in _MOMENTS.items() if known is self)

    @classmethod
    def of_parts(cls, size: int) -> "Moments":
        return moments_of(size)


def _free_matrices() -> FloatArray:
    """(9, 3, 3): identity, e_a~ for each axis, e1 e1^T, e2 e2^T, and symmetric pairs yz, xz, xy."""
    e = np.eye(3)
    pairs = [np.outer(e[i], e[j]) + np.outer(e[j], e[i]) for i, j in ((1, 2), (0, 2), (0, 1))]
    # e3 e3^T is the identity less the other two
    return np.stack([e, *GENERATORS[3], np.outer(e[0], e[0]), np.outer(e[1], e[1]), *pairs])


def _free_factors(w: FloatArray, al: FloatArray) -> FloatArray:
    """`Moments.factors` of `_free_matrices`."""
    # one by one Python's own numbers are quicker
    a, b, c = w.tolist() if w.ndim == 1 else w.T
    x, y, z = al.tolist() if al.ndim == 1 else al.T
    return np.array([
        -a * a - b * b, x, y, z, a * a - c * c, b * b - c * c, b * c, a * c, a * b]).T


def _free_slopes(w: FloatArray) -> FloatArray:
    a, b, c = w.tolist()
    return np.array([
        [-2 * a, -2 * b, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [2 * a, 0, -2 * c],
        [0, 2 * b, -2 * c], [0, c, b], [c, 0, a], [b, a, 0]], dtype=np.float64)


def _free() -> Moments:
    """Nine matrices, for a free attitude: all components of T."""
    B = _free_matrices()
    dual = np.linalg.inv(B.reshape(9, 9)).T.reshape(9, 3, 3)  # T = sum_g N_g dual_g
    trace = np.einsum("gii,ab->gab", dual, np.eye(3))
    tensor = (trace - dual.transpose(0, 2, 1)).transpose(1, 2, 0).copy()
    turn = np.zeros((9, 3))
    turn[1:4] = np.eye(3)
    return _of(B, tensor, np.einsum("abc,gbc->ag", LEVI_CIVITA, dual), _free_factors, _free_slopes,
               turn, ("of size", "about x", "about y", "about z", "xx", "yy", "yz", "xz", "xy"))


def _spin_factors(w: FloatArray, al: FloatArray) -> FloatArray:
    found = np.zeros(w.shape)
    found[..., 1], found[..., 2] = al[..., 2], -w[..., 2] ** 2
    return found


def _spin() -> Moments:
    """Three matrices, for rotation about z: the components of T that the torque about z and a
    rotation about z need."""
    B = np.stack([np.eye(3), GENERATORS[3][2], np.diag([1.0, 1.0, 0.0])])
    tensor, axial, turn = np.zeros((3, 3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    tensor[2, 2, 2], axial[2, 1], turn[1, 2] = 1.0, -1.0, 1.0
    return _of(
        B, tensor, axial, _spin_factors,
        lambda w: np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -2.0 * w[2]]]), turn,
        ("", "about z", "outward"))


def _of(
    B: FloatArray, tensor: FloatArray, axial: FloatArray, factors: Rates,
    slopes: Callable[[FloatArray], FloatArray], turn: FloatArray, names: tuple[str, ...],
) -> Moments:
    signs = np.array([1.0 if np.array_equal(b, b.T) else -1.0 for b in B])
    return Moments(B, signs, 1.0 + signs, tensor, tensor.transpose(0, 2, 1).copy(), axial, factors,
                   slopes, turn, tuple(n and f"inertia {n}" for n in names))


def _plane() -> Moments:
    """Two matrices, for the plane: the identity (centrifugal loads) and the quarter turn (Euler
    loads)."""
    B = np.stack([np.eye(2), GENERATORS[2][0]])
    return _of(
        B, np.array([[[1.0, 0.0]]]), np.array([[0.0, -1.0]]),
        lambda w, al: np.array([-w[..., 0] ** 2, al[..., 0]]).T,
        lambda w: np.array([[-2.0 * w[0]], [0.0]]), np.array([[0.0], [1.0]]),
        ("outward", "around"))


_MOMENTS = {PLANAR_POSE: _plane(), SPINNING_POSE: _spin(), FREE_POSE: _free()}


def moments_of(size: int) -> Moments:
    """Moments for frames with `size` rigid coordinates: 3 in the plane; in space 7 for a free
    attitude, or 4 for rotation about z alone."""
    return _MOMENTS[size]
