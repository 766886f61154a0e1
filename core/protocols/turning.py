"""Unit quaternions in time steps, as functions on small arrays, which numba can compile.

The equations of a step have two solutions p near +f and -f, f the free motion, and errors of the
multiplier that keeps |p| = 1 feed back into the components of rates and accelerations along p:
under generalized_alpha they grew until a step ended at -p, and the body stopped turning. These
components follow from |p| = 1 alone, p . p' = 0 and p . p'' = -p' . p', and angular velocities and
accelerations do not contain them: after each step they are set to these values (`tangent`). The
guess of a step is kept near +f (`steered`).
"""

from math import sqrt

from sparsemor.core.arrays import FloatArray

FAR = 0.5
"""Distance of a guessed quaternion from the direction of its free motion beyond which the latter is
the guess."""


def tangent(p: FloatArray, v: FloatArray, a: FloatArray) -> None:
    """Makes the rates v and second derivatives a (4,) of a unit quaternion p (4,) consistent with
    |p| = 1, in place."""
    along = p[0] * v[0] + p[1] * v[1] + p[2] * v[2] + p[3] * v[3]
    for i in range(4):
        v[i] -= along * p[i]
    along = (p[0] * a[0] + p[1] * a[1] + p[2] * a[2] + p[3] * a[3]
             + v[0] ** 2 + v[1] ** 2 + v[2] ** 2 + v[3] ** 2)
    for i in range(4):
        a[i] -= along * p[i]


def steered(d: FloatArray, free: FloatArray) -> None:
    """Replaces the guessed departure d (4,) of a quaternion from its free motion (4,) by that to
    the unit quaternion in this direction if it is far from it: from a guess near the opposite one
    the iteration would end there, and the body turn backwards."""
    size = sqrt(free[0] ** 2 + free[1] ** 2 + free[2] ** 2 + free[3] ** 2)
    scale = 1.0 / size - 1.0 if size > 0.0 else 0.0
    square = 0.0
    for i in range(4):
        square += (d[i] - scale * free[i]) ** 2
    if not square <= FAR * FAR:
        for i in range(4):
            d[i] = scale * free[i]
