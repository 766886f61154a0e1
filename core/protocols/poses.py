"""Positions of body points from the rigid coordinates (pose) of a body frame: planar (Rx, Ry,
theta), spinning about one axis (R, angle about z), or spatial (R, unit quaternion), distinguished
by their number 3, 4 or 7."""

from math import sqrt

import numpy as np

from sparsemor.core.arrays import FloatArray

PLANAR_POSE, SPINNING_POSE, FREE_POSE = 3, 4, 7
QUATERNION = 4
"""Number of the last coordinates of a free frame, its quaternion."""
KNOWN = (PLANAR_POSE, SPINNING_POSE, FREE_POSE)
BY_ANGLE = (PLANAR_POSE, SPINNING_POSE)
"""Numbers of rigid coordinates of the frames whose last coordinate is an angle, rad."""
COORDINATES = {PLANAR_POSE: ("x", "y", "angle"), SPINNING_POSE: ("x", "y", "z", "angle"),
               FREE_POSE: ("x", "y", "z", "q0", "q1", "q2", "q3")}
"""Number of rigid coordinates of a frame -> their names; q: unit quaternion."""
COORDINATE_UNITS = dict.fromkeys("xyz", "m") | {"angle": "rad"} | {f"q{i}": "1" for i in range(4)}


def points_in_space(pose: FloatArray, z: FloatArray) -> FloatArray:
    """Positions R + A z (j, d), m, of body points z (j, d) under poses (j, n): origin R and angle
    in the plane (n = 3); in space R and angle about the z axis (4) or R and quaternion p0, e (7).
    """
    if pose.shape[1] in BY_ANGLE:
        cos, sin = np.cos(pose[:, -1]), np.sin(pose[:, -1])
        across = [pose[:, 0] + cos * z[:, 0] - sin * z[:, 1],
                  pose[:, 1] + sin * z[:, 0] + cos * z[:, 1]]
        rest = [pose[:, 2] + z[:, 2]] if pose.shape[1] == SPINNING_POSE else []
        return np.stack(across + rest, axis=1)
    p0, e = pose[:, 3:4], pose[:, 4:]
    # A z = (p0^2 - e.e) z + 2 e (e.z) + 2 p0 e x z
    scale = p0**2 - np.sum(e * e, axis=1, keepdims=True)
    turned = scale * z + 2 * e * np.sum(e * z, axis=1, keepdims=True) + 2 * p0 * np.cross(e, z)
    return np.asarray(pose[:, :3] + turned)


def vectors_in_space(pose: FloatArray, z: FloatArray) -> FloatArray:
    """Vectors A z (j, d) in inertial axes, from z (d,) or (j, d) in body axes under poses (j, n);
    without the origin R, so that a distant position costs no digits."""
    d = 2 if pose.shape[1] == PLANAR_POSE else 3
    at_origin = pose.copy()
    at_origin[:, :d] = 0.0
    return points_in_space(at_origin, np.broadcast_to(z, (len(pose), d)))


def unit_attitude(pose: FloatArray) -> FloatArray:
    """Pose (n,) with its quaternion, if it has one, normalised."""
    if len(pose) != FREE_POSE:
        return pose
    return np.concatenate([pose[:3], pose[3:] / np.linalg.norm(pose[3:])])


def angle_between(first: FloatArray, pose: FloatArray) -> FloatArray:
    """Rotation angle (j,), rad, from poses `first` (j, n) or (1, n) to poses (j, n): of spatial
    ones 0 to pi."""
    if pose.shape[1] in BY_ANGLE:
        return np.asarray(np.abs(pose[:, -1] - first[:, -1]))
    p0, e0, p, e = first[:, 3], first[:, 4:], pose[:, 3], pose[:, 4:]
    # the product of a quaternion with the conjugate of the first
    scalar = p0 * p + (e * e0).sum(axis=1)
    vector = p0[:, None] * e - p[:, None] * e0 - np.cross(e, e0)
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(vector, axis=1), np.abs(scalar)))


LEFT = np.array([
    [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, -1], [0, 0, 1, 0]],
    [[0, 0, -1, 0], [0, 0, 0, 1], [1, 0, 0, 0], [0, -1, 0, 0]],
    [[0, 0, 0, -1], [0, 0, -1, 0], [0, 1, 0, 0], [1, 0, 0, 0]]], dtype=np.float64)
"""Products with 1, i, j, k from the left."""


def turns_from(q: FloatArray) -> FloatArray:
    """Matrices (k, 4, 4, 4) whose sum with the components of quaternions p (k, 4) as weights is the
    orthogonal matrix by which quaternions, and their derivatives, turn from attitudes q (k, 4) to
    p; it makes p of q."""
    return np.asarray(LEFT @ np.tensordot(q, LEFT, 1).transpose(0, 2, 1)[:, None])


def turns(p: FloatArray, q: FloatArray) -> FloatArray:
    """The matrices (k, 4, 4) by which attitudes turn from q (k, 4) to p (k, 4)."""
    return np.asarray((p[:, None] @ turns_from(q).reshape(len(q), 4, 16)).reshape(-1, 4, 4))


FAR = 0.5
"""Distance of a guessed quaternion from the direction of its free motion beyond which the latter is
the guess."""


def tangent(p: FloatArray, v: FloatArray, a: FloatArray) -> None:
    """Makes the rates v and second derivatives a (4,) of a unit quaternion p (4,) consistent with
    |p| = 1, in place: p . p' = 0 and p . p'' = -p' . p'.

    The equations of a step have two solutions p near +f and -f, f the free motion, and errors of
    the multiplier that keeps |p| = 1 feed back into the components of rates and accelerations along
    p: under generalized_alpha they grew until a step ended at -p, and the body stopped turning.
    Angular velocities and accelerations do not contain these components, and |p| = 1 alone gives
    them: after each step they are set to these values. Numba can compile it.
    """
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
    scale = 1.0 / size - 1.0 if size > 0.0 else 0.0  # free / |free| - free = scale free
    square = 0.0
    for i in range(4):
        square += (d[i] - scale * free[i]) ** 2
    if not square <= FAR * FAR:
        for i in range(4):
            d[i] = scale * free[i]


def in_degrees(angle: float) -> bool:
    """True for a round number of more than a whole turn, as angles in degrees are."""
    return abs(angle) > 2.0 * np.pi and float(2.0 * angle).is_integer()
