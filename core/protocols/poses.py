"""Positions of body points: planar frames (Rx, Ry, theta), spinning ones (R, angle about z) and
free ones in space (R, quaternion). The number of their coordinates distinguishes them: 3, 4 and 7.
"""

import numpy as np

from sparsemor.core.arrays import FloatArray

PLANAR_POSE, SPINNING_POSE, FREE_POSE = 3, 4, 7
KNOWN = (PLANAR_POSE, SPINNING_POSE, FREE_POSE)
BY_ANGLE = (PLANAR_POSE, SPINNING_POSE)
"""Frames whose last coordinate is their angle, rad."""


def points_in_space(pose: FloatArray, z: FloatArray) -> FloatArray:
    """(j, d) positions R + A z, m, of body points z (j, d) under poses (j, 3), (j, 4) or (j, 7)."""
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
    """(j, d) vectors A z in space axes, of z (d,) or (j, d) in body axes under poses (j, n).

    No digits are lost to a position far away.
    """
    d = 2 if pose.shape[1] == PLANAR_POSE else 3
    at_origin = pose.copy()
    at_origin[:, :d] = 0.0
    return points_in_space(at_origin, np.broadcast_to(z, (len(pose), d)))


def unit_attitude(pose: FloatArray) -> FloatArray:
    """The same pose (n,) with a quaternion, if it has one, of length 1."""
    if len(pose) != FREE_POSE:
        return pose
    return np.concatenate([pose[:3], pose[3:] / np.linalg.norm(pose[3:])])


def turned_by(pose: FloatArray) -> FloatArray:
    """(j,) angle of the rotation from the first of poses (j, 7) to each, 0 to pi rad."""
    (p0, *e0), p, e = pose[0, 3:], pose[:, 3], pose[:, 4:]
    # the product of a quaternion with the first one's conjugate
    scalar = p0 * p + e @ np.array(e0)
    vector = p0 * e - p[:, None] * np.array(e0) - np.cross(e, e0)
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(vector, axis=1), np.abs(scalar)))
