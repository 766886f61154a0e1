"""Second moments of a body's mass, and the constant tensors that make its inertia of them.

The inertia of z = X + u needs T = sum m z y^T for y = z, u', u''. A set of 3 x 3 matrices B_g that
spans what is needed of T gives the generators M_g = m (x) B_g of the elastic inertia
(equations.md, section 1) and the numbers N_g = z.M_g y = B_g : T.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sparsemor.bodies.frames.rotation import LEVI_CIVITA
from sparsemor.core import FloatArray

Rates = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """g matrices B (g, 3, 3), the identity first; M_g^T = signs_g M_g; N_g(z) changes by
    symmetric_g (M_g z).dz; names: what M_g X is a load of, "" for none.

    tensor (3, 3, g): moments of inertia J = tensor N(z); levers (3, g, 3) the same numbers; axial
    (3, g): sum z x m y = axial N(y). factors(w, al) (g,): sum_g factor_g B_g = w~ w~ + al~ in body
    axes, (T, g) of rates (T, 3); slopes(w) (g, 3): their derivative by w; turn (g, 3): by al.
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
        """(g,) of a second moment T (3, 3) = sum m z y^T."""
        return np.asarray(np.tensordot(self.B, T, 2))

    def of_inertia(self, J: FloatArray) -> FloatArray:
        """(g,) of a rigid body with inertia tensor J (3, 3) about the frame origin."""
        return self.numbers(0.5 * np.trace(J) * np.eye(3) - J)


TURNS = -LEVI_CIVITA
"""(3, 3, 3): e1~, e2~, e3~."""


def _free_matrices() -> FloatArray:
    e = np.eye(3)
    pairs = [np.outer(e[i], e[j]) + np.outer(e[j], e[i]) for i, j in ((1, 2), (0, 2), (0, 1))]
    # e3 e3^T is the identity less the other two
    return np.stack([e, *TURNS, np.outer(e[0], e[0]), np.outer(e[1], e[1]), *pairs])


def _free_factors(w: FloatArray, al: FloatArray) -> FloatArray:
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
    """Nine matrices, all of T."""
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
    """Three matrices: what the torque about z and a turn about z ask for, no more."""
    B = np.stack([np.eye(3), TURNS[2], np.diag([1.0, 1.0, 0.0])])
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


FREE, SPIN = _free(), _spin()


def moments_of(size: int) -> Moments:
    """For frames with `size` rigid coordinates: 7, free, or 4, turning about z alone."""
    return FREE if size == 7 else SPIN
