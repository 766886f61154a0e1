"""Motion of a frame in space as functions on arrays, which are also compiled: rotation matrices
with their derivatives by the attitude coordinates, and products of vectors.

The attitude has n coordinates: 4, a quaternion p = (p0, e), or 1, an angle about z (attitude.py,
rotation.py). The rotation matrix of a quaternion, A = (p0^2 - e.e) 1 + 2 e e^T + 2 p0 e~, is
quadratic, so that its derivatives D_k are linear in p and A = sum p_k D_k / 2. Vectors (3,) are
tuples.
"""

from math import cos, sin
from typing import NamedTuple, TypeAlias

from sparsemor.core import FloatArray

Vector: TypeAlias = tuple[float, float, float]
NONE: Vector = (0.0, 0.0, 0.0)


class SpaceMotion(NamedTuple):
    """State of one body in space, as a tuple, also for compiled code.

    n: number of attitude coordinates; y: rigid coordinates and multipliers, v: their rates; R, acc:
    position and its second derivative; A (3, 3), D (n, 3, 3): rotation matrix and its derivatives;
    w, al: angular velocity and acceleration in body axes, with derivatives dw, dal (n, 3); lever
    (n, 3): generalized force per torque in body axes; c1, c2: dv = c1 dy, da = c2 dy of the time
    integration. elastic: True if the body deforms; then s, s1, s2 (p,): functionals of the
    displacements u, u', u'', and forms (3 g,): u.M_g u, u.M_g u', u.M_g u''. rest (5, 3, 3), far
    (5, 3, 3), pairs (14, 2, 3), square (8, 8): working arrays.
    """

    n: int
    y: FloatArray
    v: FloatArray
    R: Vector
    acc: Vector
    A: FloatArray
    D: FloatArray
    w: Vector
    al: Vector
    dw: FloatArray
    dal: FloatArray
    lever: FloatArray
    c1: float
    c2: float
    elastic: bool
    s: FloatArray
    s1: FloatArray
    s2: FloatArray
    forms: FloatArray
    rest: FloatArray
    far: FloatArray
    pairs: FloatArray
    square: FloatArray


class SpaceSums(NamedTuple):
    """Arrays of a FrameWork to which parts add: sigma (p,), factors of functionals s in the elastic
    rows, sigma_y = d sigma / dy and tau = d rows / ds (b, p), H = d rows / dy (b, b), rows (b,),
    coefficients (2 g + 1,) of M_g u, M_g u', and 1."""

    sigma: FloatArray
    sigma_y: FloatArray
    tau: FloatArray
    H: FloatArray
    rows: FloatArray
    coefficients: FloatArray


def vector(x: FloatArray, i: int) -> Vector:
    """Entries i, i + 1, i + 2 of x."""
    return (x[i], x[i + 1], x[i + 2])


def plus(a: Vector, g: float, b: Vector) -> Vector:
    """a + g b."""
    return (a[0] + g * b[0], a[1] + g * b[1], a[2] + g * b[2])


def dot(a: Vector, b: Vector) -> float:
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def times(A: FloatArray, b: Vector) -> Vector:
    """A b for a matrix A (3, 3)."""
    return (A[0, 0] * b[0] + A[0, 1] * b[1] + A[0, 2] * b[2],
            A[1, 0] * b[0] + A[1, 1] * b[1] + A[1, 2] * b[2],
            A[2, 0] * b[0] + A[2, 1] * b[1] + A[2, 2] * b[2])


def back(A: FloatArray, f: Vector) -> Vector:
    """A^T f for a matrix A (3, 3)."""
    return (A[0, 0] * f[0] + A[1, 0] * f[1] + A[2, 0] * f[2],
            A[0, 1] * f[0] + A[1, 1] * f[1] + A[2, 1] * f[2],
            A[0, 2] * f[0] + A[1, 2] * f[1] + A[2, 2] * f[2])


def add(x: FloatArray, i: int, g: float, a: Vector) -> None:
    """Adds g a to entries i, i + 1, i + 2 of x."""
    x[i] += g * a[0]
    x[i + 1] += g * a[1]
    x[i + 2] += g * a[2]


def put(x: FloatArray, a: Vector) -> None:
    """Writes a to x (3,)."""
    x[0], x[1], x[2] = a[0], a[1], a[2]


def turn(q: FloatArray, i: int, n: int, X: FloatArray) -> None:
    """Rotation matrix X[0] and its derivatives X[1:] by the n attitude coordinates from number i
    of q on: an angle about z (n = 1), or four Euler parameters (n = 4)."""
    if n == 1:
        cosine, sine = cos(q[i]), sin(q[i])
        put(X[0, 0], (cosine, -sine, 0.0))
        put(X[0, 1], (sine, cosine, 0.0))
        put(X[0, 2], (0.0, 0.0, 1.0))
        put(X[1, 0], (-sine, -cosine, 0.0))
        put(X[1, 1], (cosine, -sine, 0.0))
        put(X[1, 2], (0.0, 0.0, 0.0))
        return
    p, a, b, c = 2.0 * q[i], 2.0 * q[i + 1], 2.0 * q[i + 2], 2.0 * q[i + 3]
    put(X[1, 0], (p, -c, b))
    put(X[1, 1], (c, p, -a))
    put(X[1, 2], (-b, a, p))
    put(X[2, 0], (a, b, c))
    put(X[2, 1], (b, -a, -p))
    put(X[2, 2], (c, p, -a))
    put(X[3, 0], (-b, a, p))
    put(X[3, 1], (a, b, c))
    put(X[3, 2], (-p, c, -b))
    put(X[4, 0], (-c, -p, a))
    put(X[4, 1], (p, -c, b))
    put(X[4, 2], (a, b, c))
    # quadratic in the parameters q_k (Euler): R = 1/2 sum q_k dR/dq_k, and p .. c are 2 q_k
    for r in range(3):
        for k in range(3):
            X[0, r, k] = 0.25 * (
                p * X[1, r, k] + a * X[2, r, k] + b * X[3, r, k] + c * X[4, r, k])


def turn_rate(q1: FloatArray, i: int, n: int, A: FloatArray, X: FloatArray) -> None:
    """Rates X[1:] of the derivatives of the rotation matrix A, for rates q1 of its n coordinates
    from number i on."""
    if n == 4:  # these derivatives are linear in the parameters
        turn(q1, i, n, X)
        return
    for r in range(3):
        put(X[1, r], (-q1[i] * A[r, 0], -q1[i] * A[r, 1], 0.0))


def bend(n: int, A: FloatArray, f: Vector, b: Vector, k: int, c: int) -> float:
    """Second derivative of f . A b by the attitude coordinates k and c, 0 to n - 1."""
    if n == 1:
        return -dot(f, times(A, (b[0], b[1], 0.0)))
    if k == 0 and c == 0:
        return 2.0 * dot(f, b)
    if k == 0 or c == 0:
        return 2.0 * cross(b, f)[k + c - 1]
    i, j = k - 1, c - 1
    return 2.0 * (f[i] * b[j] + f[j] * b[i] - (dot(f, b) if i == j else 0.0))


def add_bend(
    H: FloatArray, at: int, n: int, A: FloatArray, g: float, f: Vector, b: Vector
) -> None:
    """Adds g times the second derivatives of f . A b to H, whose attitude coordinates start at
    `at`."""
    for k in range(n):
        for c in range(n):
            H[at + k, at + c] += g * bend(n, A, f, b, k, c)


def levers(q: FloatArray, i: int, n: int, g: float, out: FloatArray) -> None:
    """Adds g times 2 G^T (rotation.py), for an angle g e_z, to `out` (n, 3)."""
    if n == 1:
        out[0, 2] += g
        return
    p, e = q[i], vector(q, i + 1)
    add(out[0], 0, -2.0 * g, e)
    add(out[1], 0, 2.0 * g, (p, -e[2], e[1]))
    add(out[2], 0, 2.0 * g, (e[2], p, -e[0]))
    add(out[3], 0, 2.0 * g, (-e[1], e[0], p))


def spin(lever: FloatArray, q1: FloatArray, i: int, n: int) -> Vector:
    """Angular velocity in body axes for rates of the coordinates from number i of q1 on."""
    w = NONE
    for k in range(n):
        w = plus(w, q1[i + k], vector(lever[k], 0))
    return w


def add_torque(m: SpaceMotion, torque: Vector, out: SpaceSums) -> None:
    """Adds a torque in body axes to the rows of the n attitude coordinates, numbers 3 on in y, with
    the derivatives H of these at a constant torque, unless c2 = 0; lever = 2 G^T of the quaternion
    p (rotation.py), linear in p."""
    for k in range(m.n):
        out.rows[3 + k] += dot(vector(m.lever[k], 0), torque)
    if m.n == 4 and m.c2 != 0.0:  # d (2 G^T torque) / dp
        H, (x, y, z) = out.H, torque
        add(H[3], 4, -2.0, torque)
        for i in range(3):
            H[4 + i, 3] += 2.0 * torque[i]
        add(H[4], 4, 2.0, (0.0, z, -y))
        add(H[5], 4, 2.0, (-z, 0.0, x))
        add(H[6], 4, 2.0, (y, -x, 0.0))
