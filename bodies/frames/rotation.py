"""Rotations by unit quaternions p = (p0, p1, p2, p3), and their derivatives.

With the (3, 4) matrices E(p) and G(p) of Nikravesh 1988 (Computer-Aided Analysis of Mechanical
Systems, ch. 6) the rotation is A = E G^T and the angular rates in body axes are w = 2 G p',
alpha = 2 G p''. A is quadratic in p and no angle is ever formed, so no attitude is singular. For
|p| = 1 A is a rotation; elsewhere it is |p|^2 times one, which keeps every derivative here exact
off the constraint, where Newton's method visits.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from sparsemor.core import FloatArray

LEVI_CIVITA = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    LEVI_CIVITA[_i, _j, _k], LEVI_CIVITA[_i, _k, _j] = 1.0, -1.0
_SKEW = -LEVI_CIVITA
_EYE = np.eye(3)
GENERATORS: Mapping[int, FloatArray] = {
    2: np.array([[[0.0, -1.0], [1.0, 0.0]]]), 3: _SKEW}
"""Dimension d -> generators of rotations (r, d, d), r = 1 or 3: generator a times z is e_a x z."""


def _linear(sign: float) -> FloatArray:
    """(3, 4, 4) tensor of the linear map p -> [-e, p0 I + sign e~] with p = (p0, e)."""
    T = np.zeros((3, 4, 4))
    T[:, 0, 1:] = -_EYE
    T[:, 1:, 0] = _EYE
    T[:, 1:, 1:] = sign * _SKEW
    return T


_E, _G = _linear(1.0), _linear(-1.0)
# E(p)^T f = F(f) p and G(p)^T b = B(b) p: the same numbers, the other factor held
_F, _B = (T.transpose(1, 2, 0).copy() for T in (_E, _G))


def skew(v: FloatArray) -> FloatArray:
    """Cross-product matrix v~ with v~ w = v x w."""
    return np.asarray(_SKEW.dot(v))


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross product a x b of vectors (3,); ten times as fast as numpy.cross."""
    return np.asarray(_SKEW.dot(a).dot(b))


def torque(arm: FloatArray, force: FloatArray) -> FloatArray:
    """(n, r) cross products arm x force of vectors (n, d); r = 1 in the plane and 3 in space."""
    return np.asarray(np.einsum("aij,nj,ni->na", GENERATORS[arm.shape[1]], arm, force))


def to_space(p: FloatArray) -> FloatArray:
    """Matrix E(p) (3, 4)."""
    return np.asarray(_E.dot(p))


def to_body(p: FloatArray) -> FloatArray:
    """Matrix G(p) (3, 4)."""
    return np.asarray(_G.dot(p))


def rotation(p: FloatArray) -> FloatArray:
    """Rotation matrix A(p) (3, 3), from body axes to space axes."""
    return np.asarray(_E.dot(p).dot(_G.dot(p).T))


def of_body_vector(E: FloatArray, b: FloatArray) -> FloatArray:
    """(3, 4) derivative d (A b) / dp for a vector b in body axes, with E = to_space(p)."""
    return np.asarray(2.0 * E.dot(_B.dot(b)))


def of_space_vector(G: FloatArray, f: FloatArray) -> FloatArray:
    """(3, 4) derivative d (A^T f) / dp for a vector f in space axes, with G = to_body(p)."""
    return np.asarray(2.0 * G.dot(_F.dot(f)))


def bend(f: FloatArray, b: FloatArray) -> FloatArray:
    """(4, 4) second derivative of f . A(p) b by p: symmetric and constant."""
    return np.asarray(2.0 * _F.dot(f).T.dot(_B.dot(b)))


def of_moment(b: FloatArray) -> FloatArray:
    """(4, 4) derivative d (2 G(p)^T b) / dp of the generalized force of a torque b."""
    return np.asarray(2.0 * _B.dot(b))


def product(p: FloatArray, q: FloatArray) -> FloatArray:
    """Quaternion of the rotation q followed by p: A(product(p, q)) = A(p) A(q)."""
    a, b = p[1:], q[1:]
    return np.concatenate([[p[0] * q[0] - a @ b], p[0] * b + q[0] * a + cross(a, b)])


def products(p: FloatArray, q: FloatArray) -> FloatArray:
    """(T, 4) products of quaternions p (T, 4) with one, q (4,), as `product`."""
    w, a, b, c = q.tolist()
    by = [[w, a, b, c], [-a, w, -c, b], [-b, c, w, -a], [-c, -b, a, w]]  # of 1, i, j, k
    return np.asarray(p.dot(np.array(by)))


def conjugate(p: FloatArray) -> FloatArray:
    """Quaternion (4,) of the inverse rotation."""
    return np.asarray(p * np.array([1.0, -1.0, -1.0, -1.0]))


def about(axis: Sequence[float], angle: float) -> FloatArray:
    """Unit quaternion of a rotation by `angle` (rad) about `axis`, which need not have unit length.
    """
    a = np.array(axis, dtype=np.float64)
    return np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * a / np.linalg.norm(a)])


def rates(p: FloatArray, spin: FloatArray) -> FloatArray:
    """Rate p' (4,) of a quaternion for an angular velocity in space axes, rad/s."""
    return np.asarray(0.5 * _E.dot(p).T.dot(spin))


def across(axis: FloatArray) -> tuple[FloatArray, ...]:
    """Unit vectors that complete the unit vector `axis` (d,) to a right-handed system: e1, e2 with
    (e1, e2, axis) in space; e1 with (axis, e1) in the plane."""
    if len(axis) == 2:
        return (np.asarray(GENERATORS[2][0].dot(axis)),)
    first = cross(axis, _EYE[int(np.argmin(np.abs(axis)))])
    first = first / np.linalg.norm(first)
    return first, cross(axis, first)
