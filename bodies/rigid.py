"""Rigid body given by mass and inertia: three coordinates in the plane, seven or four in space."""

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.bodies.frames.mass_moments import MassProperties
from sparsemor.bodies.initial_pose import Pose, Vector
from sparsemor.bodies.terms.field_kinds import BODY_KINDS
from sparsemor.core import BodyPlugin, Fault, FieldKind, FloatArray, InputError

Row = tuple[float, float, float]


class Rigid(BodyPlugin):
    """Rigid body: Newton-Euler equations about the frame origin (equations.md, 1, without u).

    Its inertia determines the dimension: one number makes a planar body, a tensor one in space.
    """

    field_kinds: ClassVar[tuple[FieldKind, ...]] = BODY_KINDS

    mass: float = Field(gt=0)
    """Mass, kg."""
    inertia: float | Row | tuple[Row, Row, Row]
    """Inertia about the centre of mass, kg m^2: the moment of inertia in the plane; in space the
    three principal moments about the frame's axes, or the whole tensor (3 x 3)."""
    center: Vector = (0.0, 0.0)
    """Centre of mass in the body frame, m."""
    points: dict[str, Vector] = {}
    """Named points for joints, loads and probes: body-frame coordinates, m."""
    frame: Literal["floating", "spinning"] = "floating"
    """Motion of the body frame. `spinning`: a body in space that rotates about the z axis alone, by
    an angle."""
    pose: Pose = Pose()
    """Initial position and rotation of the frame, and their rates."""

    @property
    def stored_classes(self) -> Sequence[object]:
        """Classes of the frames and terms of a kept model."""
        from sparsemor.bodies.stored_classes import CLASSES

        return CLASSES

    def build(self, name: str, base: Path) -> FloatingBody:
        """The body, planar for one moment of inertia, in space for a tensor or three principal
        moments. J: about the centre of mass, kg m2; its points are its only nodes, a set each."""
        J = np.array(self.inertia, dtype=np.float64)
        d, spins = (3 if J.ndim else 2), self.frame == "spinning"
        if d == 2 and spins:
            raise InputError("one number for the inertia makes a planar body, which turns about "
                             "one axis anyway: drop it, or give a tensor", "frame")
        self._check_vectors(d)
        J = np.diag(J) if J.ndim == 1 else J
        _check_inertia(J)
        center = np.array(self.center if len(self.center) == d else d * (0.0,))
        pose, velocity = self.pose.start(d, spins)
        return FloatingBody(
            name=name, X=np.array(list(self.points.values()), dtype=np.float64).reshape(-1, d),
            inertia=MassProperties.rigid(self.mass, center, J), pose=pose, velocity=velocity,
            moves=True, points={p: np.array([i]) for i, p in enumerate(self.points)})

    def _check_vectors(self, d: int) -> None:
        """InputError for a centre or points of the other dimension; a zero centre fits both."""
        kind = "one number, so the body is plane" if d == 2 else "a tensor, so the body is in space"
        faults = [Fault(key, f"the inertia is {kind}: give {d} coordinates (got {list(v)})")
                  for key, v in (("center", self.center), *(
                      (f"points.{n}", p) for n, p in self.points.items()))
                  if len(v) != d and (any(v) or key != "center")]
        if faults:
            raise InputError(faults)


def _check_inertia(J: FloatArray) -> None:
    """InputError for an inertia that no body has.

    In the plane J >= 0; in space the tensor is symmetric, and no principal moment exceeds the sum
    of the other two.
    """
    if J.ndim == 0:
        if J < 0:
            raise InputError(f"a moment of inertia is not negative (got {J:g})", "inertia")
        return
    size = float(np.abs(J).max())
    if np.abs(J - J.T).max() > 1e-9 * size:
        raise InputError("the inertia tensor is not symmetric", "inertia")
    moments = np.linalg.eigvalsh(J)
    if moments[0] <= 0:
        raise InputError("principal moments of inertia must be positive: they are "
                         f"{', '.join(f'{m:.6g}' for m in moments)} kg m^2", "inertia")
    if moments[2] > (moments[0] + moments[1]) * (1 + 1e-9):
        raise InputError(
            "no distribution of mass has these principal moments: "
            f"{moments[2]:.6g} is more than {moments[0]:.6g} + {moments[1]:.6g} kg m^2", "inertia")
