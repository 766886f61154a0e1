"""Forces with components, on bodies of either dimension."""

from collections.abc import Sequence

import numpy as np

from sparsemor.bodies.any_body import AnyBody
from sparsemor.bodies.frame_term import FrameTerm
from sparsemor.bodies.spatial.body import SpatialBody
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.layout import Layout
from sparsemor.core.separable import Amplitude

Vector = tuple[float, float] | tuple[float, float, float]


def components(body: AnyBody, vector: Sequence[float], key: str) -> FloatArray:
    """(d,) of a vector that suits the body; InputError when it has more or fewer components."""
    d = 3 if isinstance(body, SpatialBody) else 2
    if len(vector) != d:
        where = "in space: give three components" if d == 3 else "plane: give two components"
        raise InputError(f"body {body.name!r} is {where} (given: {list(vector)})", key)
    return np.array(vector, dtype=np.float64)


def space_force(
    body: AnyBody, layout: Layout, weights: FloatArray, force: FloatArray, amplitude: Amplitude
) -> FrameTerm:
    """Nodal weights (N,) times one force (d,) in space axes, N per unit weight."""
    if isinstance(body, SpatialBody):
        return body.space_force(layout, weights, force, amplitude)
    return body.space_force(layout, weights, complex(*force), amplitude)


def body_force(
    body: AnyBody, layout: Layout, forces: FloatArray, amplitude: Amplitude
) -> FrameTerm:
    """Nodal forces (N, d) that turn with the body frame, N."""
    if isinstance(body, SpatialBody):
        return body.body_force(layout, forces, amplitude)
    return body.body_force(layout, forces[:, 0] + 1j * forces[:, 1], amplitude)


def weight(
    body: AnyBody, layout: Layout, g: FloatArray, amplitude: Amplitude
) -> Sequence[FrameTerm]:
    """Weight of the deformed body under an acceleration g (d,), m/s^2."""
    if isinstance(body, SpatialBody):
        return body.gravity(layout, g, amplitude)
    return (body.gravity(layout, complex(*g), amplitude),)
