"""Floating frame of a body: its rigid coordinates, inertia and weight (equations.md, section 1).

The displacements u of a body in its frame enter by functionals and matrices of its mass alone:
with shape functions N (d, n), reference positions X and the constant matrices B_g of its frame,

    first = int rho N dV,    about_g = int rho N^T B_g X dV,    M_g = int rho N^T B_g N dV.

Any discretisation has them: finite elements with nodal displacements, beams with rotations, modes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from sparsemor.bodies.frames.applied_forces import SpaceForce
from sparsemor.bodies.frames.constraints import UnitLength
from sparsemor.bodies.frames.frame import PlanarFrame, SpatialFrame
from sparsemor.bodies.frames.inertia import Inertia
from sparsemor.bodies.frames.mass_moments import MassProperties, moments_of
from sparsemor.core import Amplitude, Body, Csr, Equations, FloatArray
from sparsemor.core.protocols.body_frame import BodyFrame
from sparsemor.core.protocols.contributions import Stiffened
from sparsemor.core.protocols.poses import PLANAR_POSE
from sparsemor.core.protocols.separable import ElasticIntegrals, HeatIntegrals, StressStiffness


@dataclass(frozen=True, slots=True, eq=False)
class FieldInertia:
    """Inertia of n displacement unknowns in a body frame: first (n, d), kg, about (n, g), kg m, and
    g matrices M_g (n, n), kg, the first of which is the mass matrix."""

    first: FloatArray
    about: FloatArray
    matrices: Sequence[Csr]


def inertia_matrices(pose: FloatArray) -> FloatArray:
    """Constant matrices B_g (g, d, d) of a frame with rigid coordinates `pose` (n,); in the plane
    the identity and the quarter turn."""
    return moments_of(len(pose)).B


def write_frame(
    equations: Equations, body: Body, mass: MassProperties | None,
    field: FieldInertia | None = None, *,
    elastic_integrals: Callable[[], ElasticIntegrals] | None = None,
    heat_integrals: Callable[[], HeatIntegrals] | None = None,
    stress_stiffness: StressStiffness | None = None, stiffened: Stiffened | None = None,
) -> None:
    """Adds a body, its frame and the inertia of its rigid coordinates and displacements.

    mass: None for a massless frame; field: inertia of its displacements, if it has any, whose
    columns first (n, d) and about (n, g) are the functionals of the inertia item;
    elastic_integrals, heat_integrals, stress_stiffness, stiffened: as in `BodyRecord`. A frame at
    rest without displacements needs no inertia. A body in space that turns freely has the
    constraint |p| = 1 of its quaternion, with the factor C = 1 of its multiplier.
    """
    equations.body(
        partial(frame_of, body.flexible, len(body.pose)), body.pose, moves=body.moves,
        guide=body.guide, elastic_integrals=elastic_integrals, heat_integrals=heat_integrals,
        stress_stiffness=stress_stiffness, stiffened=stiffened)
    if mass is not None and (body.moves or body.flexible):
        equations.frame(
            body.name, Inertia.from_moments(mass, moments_of(len(body.pose))),
            None if field is None else np.concatenate([field.first, field.about], axis=1),
            generators=() if field is None else field.matrices)
    if body.moves and body.turns_freely:
        equations.frame(body.name, UnitLength(), multipliers=f"{body.name}.multiplier",
                        C=np.eye(1))


def write_weight(
    equations: Equations, body: Body, mass: MassProperties, g: FloatArray, amplitude: Amplitude,
    first: FloatArray | None = None,
) -> None:
    """Adds the weight of the deformed body, with the acceleration g (d,), m/s2, in space axes times
    a function of time; first (n, d): as in `FieldInertia`, for a body with displacements."""
    equations.frame(body.name, SpaceForce(mass.mass, mass.moment, g, amplitude), first)


def frame_of(elastic: bool, size: int, items: Sequence[Any]) -> BodyFrame:
    """Equations of a frame with `size` rigid coordinates as the sum of the given items."""
    kernel: Any = PlanarFrame if size == PLANAR_POSE else SpatialFrame
    made: BodyFrame = kernel(tuple(items), elastic, size)
    return made
