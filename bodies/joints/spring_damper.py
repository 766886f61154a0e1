"""Spring and damper along the line between two points, with an actuator force."""

from typing import ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from sparsemor.bodies.frames.springs import Spring
from sparsemor.bodies.joints.force_element import Drive, ForceElement
from sparsemor.bodies.joints.side import Side, size_of
from sparsemor.bodies.loads.part import NumberOrFunction
from sparsemor.bodies.pose import Vector
from sparsemor.core import FloatArray, InputError


class SpringDamper(ForceElement):
    """Spring, damper and actuator along the line between two points.

    Force stiffness (l - length) + damping (l' - length') + force, N, positive pulls the points
    together; l: their distance, m. A flexible side has multipliers: the force on it, N (space
    axes), and the moment that keeps its massless frame from turning, zero.
    """

    recorded: ClassVar[tuple[str, str]] = ("tension", "N")

    stiffness: float = Field(default=0.0, ge=0.0)
    """Stiffness, N/m."""
    damping: float = Field(default=0.0, ge=0.0)
    """Damping, N s/m."""
    length: NumberOrFunction | None = None
    """Length of the relaxed spring, m; the distance at the start when not given."""
    force: NumberOrFunction | None = None
    """Additional force, N; positive pulls the two points together."""
    ground: Vector | None = None
    """Point of the ground, m (space axes), if one side is `ground`; the origin when not given."""

    @model_validator(mode="after")
    def _acts(self) -> Self:
        if not self.stiffness and not self.damping and self.force is None:
            raise ValueError("it does nothing: give a stiffness, a damping or a force")
        return self

    def item(self, own: Side, other: Side, first: bool) -> Spring:
        base, place = self._base(other), self._place(other)
        start = float(np.linalg.norm(own.place() - place))
        if not start > 1e-12 * size_of(own, other):
            raise InputError("the two points coincide at the start, so the line between them has "
                             "no direction: move a body or choose other points", "between")
        drive = Drive.of(self.stiffness, self.damping, start if self.length is None else 0.0,
                      self.length, self.force)
        return Spring(own.point, base, self.stiffness, self.damping, drive,
                      len(other.pose) if other.reads else 0, other.pose)

    def _base(self, other: Side) -> FloatArray:
        """(d,) point of the other side in its axes."""
        if other.body is not None:
            if self.ground is not None:
                raise InputError("no side is `ground`: drop it", "ground")
            return other.point
        given = (0.0,) * other.d if self.ground is None else self.ground
        if len(given) != other.d:
            raise InputError(f"give {other.d} components (got {list(given)})", "ground")
        return np.array(given, dtype=np.float64)

    def _place(self, other: Side) -> FloatArray:
        """(d,) initial position of the other point, m, space axes."""
        return other.place() if other.body is not None else self._base(other)
