"""Bodies of revolution: a plane mesh is their section, x the distance from the axis y.

Integrals are over the full turn (weights 2 pi x at quadrature points), and the displacement u_x
away from the axis makes the hoop strain u_x / x. All fields are equal around the axis, so that the
body may neither tilt nor move across it, nor have forces at points.
"""

from collections.abc import Sequence

import numpy as np

from sparsemor.bodies.material import curves
from sparsemor.core import Fault, FloatArray, InputError, IntArray, Material, Mesh

ON_AXIS = 1e-12
"""Distance from the axis, relative to the size of the mesh, that is zero."""


def option_faults(
    plane: bool, materials: dict[str, Material], **options: object
) -> Sequence[Fault]:
    """Faults of options that a body of revolution does not have; options: their values; materials:
    by input key; plane: False for a mesh in space. allowed: option -> its only value, None for one
    that must not be given."""
    if not plane:
        return [Fault("axisymmetric", "the mesh is 3-D and has its own shape: drop it")]
    allowed = {"frame": ("fixed",), "thickness": (None,), "model": (None,),
               "strains": ("linear",), "coupling": ("one_way",), "capacity": ("consistent",)}
    found = [Fault(key, f"of an axisymmetric body: take {allowed[key][0]} (got {value})"
                   if allowed[key][0] is not None else "an axisymmetric body has none: drop it")
             for key, value in options.items() if value not in allowed[key]]
    for key, material in materials.items():
        for name in sorted(curves(material).keys() & {"E", "alpha"}):
            found.append(Fault(f"{key}.{name}", "of an axisymmetric body does not depend on "
                               "temperature: give a number"))
    return found


def revolved_faults(points: FloatArray) -> Sequence[Fault]:
    """Fault of a section with points (N, 2) on the other side of the axis."""
    least = float(points[:, 0].min())
    if least < -ON_AXIS * float(np.ptp(points, axis=0).max()):
        return [Fault("axisymmetric", f"the mesh reaches x = {least:g} m: x is the distance from "
                      "the axis, and must not be negative")]
    return ()


def held(mesh: Mesh, fixed: IntArray) -> IntArray:
    """Fixed displacements (numbers 2 node + component) with those of the nodes on the axis across
    it. Raises InputError where the body could still move along the axis."""
    if not (fixed % 2 == 1).any():
        raise InputError("the body can still move along its axis: hold y somewhere", "reference")
    size = float(np.ptp(mesh.points, axis=0).max())
    on_axis = np.flatnonzero(np.abs(mesh.points[:, 0]) <= ON_AXIS * size)
    return np.union1d(fixed, 2 * on_axis)
