"""Initial position and velocity of a body, in the plane or in space."""

import numpy as np

from sparsemor.bodies.frames import rotation as rot
from sparsemor.core import Fault, FloatArray, InputError, Plugin

Vector = tuple[float, float] | tuple[float, float, float]


class Pose(Plugin):
    """Initial position and rotation of a body frame, and their rates."""

    position: Vector = (0.0, 0.0)
    """Position of the frame origin, m (space axes): two numbers in the plane, three in space."""
    angle: float = 0.0
    """Rotation of the frame, rad; in space about `axis`."""
    axis: tuple[float, float, float] | None = None
    """In space: axis of the rotation (space axes), of any length; z when not given."""
    quaternion: tuple[float, float, float, float] | None = None
    """In space, instead of angle and axis: quaternion of the rotation, scalar part first, of any
    length."""
    velocity: Vector = (0.0, 0.0)
    """Velocity of the frame origin, m/s (space axes)."""
    spin: float | tuple[float, float, float] = 0.0
    """Angular velocity, rad/s; in space a vector in space axes."""

    def start(self, d: int, spins: bool = False) -> tuple[FloatArray, FloatArray]:
        """Initial rigid coordinates of a frame in d dimensions, and their rates.

        spins: the frame rotates about the z axis of space alone. InputError when the pose does not
        suit the kind of frame.
        """
        return self.in_plane() if d == 2 else self.spinning() if spins else self.in_space()

    def in_plane(self) -> tuple[FloatArray, FloatArray]:
        """Rigid coordinates (R_x, R_y, theta) and their rates; InputError when the pose is one in
        space."""
        faults = [Fault(key, f"this body is plane: give {what}") for key, what, wrong in (
            ("position", "two coordinates", len(self.position) != 2),
            ("velocity", "two components", len(self.velocity) != 2),
            ("spin", "one number, rad/s", isinstance(self.spin, tuple)),
            ("axis", "the angle alone", self.axis is not None),
            ("quaternion", "an angle", self.quaternion is not None)) if wrong]
        if faults or isinstance(self.spin, tuple):
            raise InputError(faults).under("pose")
        return np.array([*self.position, self.angle]), np.array([*self.velocity, self.spin])

    def in_space(self) -> tuple[FloatArray, FloatArray]:
        """Position and unit quaternion (7,), and their rates; InputError when the pose is a planar
        one.

        The default of two zeros means three zeros.
        """
        faults = [Fault(key, f"this body is in space: give {what}") for key, what, wrong in (
            ("position", "three coordinates", not _full(self.position)),
            ("velocity", "three components", not _full(self.velocity)),
            ("spin", "a vector [x, y, z], rad/s", isinstance(self.spin, float) and self.spin != 0),
            ("quaternion", "it or angle and axis, not both", self.quaternion is not None
             and (self.axis is not None or self.angle != 0)),
            ("quaternion", "one that is not zero", self.quaternion is not None
             and not np.any(self.quaternion)),
            ("axis", "one that is not zero", self.axis is not None and not np.any(self.axis)),
        ) if wrong]
        if faults:
            raise InputError(faults).under("pose")
        p = rot.about(self.axis or (0.0, 0.0, 1.0), self.angle)
        if self.quaternion is not None:
            p = np.array(self.quaternion) / np.linalg.norm(self.quaternion)
        spin = np.array(self.spin) if isinstance(self.spin, tuple) else np.zeros(3)
        return (np.concatenate([_three(self.position), p]),
                np.concatenate([_three(self.velocity), rot.rates(p, spin)]))

    def spinning(self) -> tuple[FloatArray, FloatArray]:
        """Position and angle about z (4,), and their rates; InputError for other rotations."""
        pose, velocity = self.in_space()
        spin = self.spin if isinstance(self.spin, tuple) else (0.0, 0.0, 0.0)
        faults = [Fault(key, f"a spinning frame turns about the z axis alone: give {what}")
                  for key, what, wrong in (
            ("spin", "[0, 0, w], rad/s", any(spin[:2])),
            ("axis", "angle about [0, 0, 1]", self.axis is not None and any(self.axis[:2])),
            ("quaternion", "angle", self.quaternion is not None)) if wrong]
        if faults:
            raise InputError(faults).under("pose")
        angle = -self.angle if self.axis is not None and self.axis[2] < 0 else self.angle
        return (np.array([*pose[:3], angle]), np.array([*velocity[:3], spin[2]]))


def _full(vector: Vector) -> bool:
    return len(vector) == 3 or not any(vector)


def _three(vector: Vector) -> FloatArray:
    return np.array(vector if len(vector) == 3 else (0.0, 0.0, 0.0), dtype=np.float64)
