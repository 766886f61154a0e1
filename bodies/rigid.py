"""A rigid body, whatever its shape: three coordinates in the plane, seven in space."""

from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from sparsemor.bodies.any_body import AnyBody
from sparsemor.bodies.frames.inertia import Inertia
from sparsemor.bodies.frames.moments import moments_of
from sparsemor.bodies.planar_body import PlanarBody
from sparsemor.bodies.pose import Pose, Vector
from sparsemor.bodies.spatial_body import SpatialBody
from sparsemor.bodies.terms.field_kinds import BODY_KINDS
from sparsemor.core import Fault, FieldKind, FloatArray, InputError, Plugin

Row = tuple[float, float, float]


class Rigid(Plugin):
    """Rigid body: Newton-Euler equations about the frame origin (equations.md, 1, without u).

    Its inertia says where it lives: one number makes a planar body, a tensor one in space.
    """

    field_kinds: ClassVar[tuple[FieldKind, ...]] = BODY_KINDS

    mass: float = Field(gt=0)
    """Mass, kg."""
    inertia: float | Row | tuple[Row, Row, Row]
    """About the centre of mass, kg m^2: the moment of inertia in the plane; in space the three
    principal moments about the frame's axes, or the whole tensor (3 x 3)."""
    center: Vector = (0.0, 0.0)
    """Centre of mass in the body frame, m."""
    points: dict[str, Vector] = {}
    """Named points for joints, loads and probes: body-frame coordinates, m."""
    frame: Literal["floating", "spinning"] = "floating"
    """`spinning`: a body in space that turns about the z axis alone, by an angle."""
    pose: Pose = Pose()
    """Frame origin, rotation and their rates at the start."""

    def build(self, name: str, base: Path) -> AnyBody:
        plane = isinstance(self.inertia, float)
        if plane and self.frame == "spinning":
            raise InputError("one number for the inertia makes a planar body, which turns about "
                             "one axis anyway: drop it, or give a tensor", "frame")
        self._check_vectors(2 if plane else 3)
        if isinstance(self.inertia, float):
            return self._in_plane(name, self.inertia)
        return self._in_space(name, np.array(self.inertia, dtype=np.float64))

    def _in_plane(self, name: str, inertia: float) -> PlanarBody:
        if inertia < 0:
            raise InputError(f"a moment of inertia is not negative (got {inertia:g})", "inertia")
        X = np.array([complex(*p) for p in self.points.values()], dtype=complex)
        com = complex(*self.center)
        return PlanarBody(
            name=name, X=X, mass=self.mass, moment=self.mass * com,
            inertia=inertia + self.mass * abs(com) ** 2,
            pose=self.pose.coordinates(), velocity=self.pose.rates(), moves=True,
            points={p: np.array([i]) for i, p in enumerate(self.points)},
        )

    def _in_space(self, name: str, J: FloatArray) -> SpatialBody:
        J = np.diag(J) if J.ndim == 1 else J
        _check_tensor(J)
        com = np.array(self.center if len(self.center) == 3 else (0.0, 0.0, 0.0))
        about_origin = J + self.mass * (com @ com * np.eye(3) - np.outer(com, com))
        spins = self.frame == "spinning"
        pose, velocity = self.pose.spinning() if spins else self.pose.in_space()
        moments = moments_of(len(pose))
        return SpatialBody(
            name=name, X=np.array(list(self.points.values()), dtype=np.float64).reshape(-1, 3),
            inertia=Inertia(
                self.mass, self.mass * com, moments.of_inertia(about_origin), moments),
            pose=pose, velocity=velocity, moves=True,
            points={p: np.array([i]) for i, p in enumerate(self.points)},
        )

    def _check_vectors(self, d: int) -> None:
        """InputError for a centre or points of the other dimension; zeros fit both."""
        kind = "one number, so the body is plane" if d == 2 else "a tensor, so the body is in space"
        faults = [Fault(key, f"the inertia is {kind}: give {d} coordinates (got {list(v)})")
                  for key, v in (("center", self.center), *(
                      (f"points.{n}", p) for n, p in self.points.items()))
                  if len(v) != d and (any(v) or key != "center")]
        if faults:
            raise InputError(faults)


def _check_tensor(J: FloatArray) -> None:
    """A real body's tensor is symmetric, and no moment exceeds the sum of the other two."""
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
