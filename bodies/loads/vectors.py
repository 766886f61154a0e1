"""Forces with components, on bodies of either dimension."""

from collections.abc import Sequence

import numpy as np

from sparsemor.bodies.any_body import AnyBody
from sparsemor.bodies.spatial_body import SpatialBody
from sparsemor.core import Equations, FloatArray, InputError
from sparsemor.core.protocols.separable import Amplitude

Vector = tuple[float, float] | tuple[float, float, float]


def components(body: AnyBody, vector: Sequence[float], key: str) -> FloatArray:
    """(d,) of a vector that suits the body; InputError when it has more or fewer components."""
    d = 3 if isinstance(body, SpatialBody) else 2
    if len(vector) != d:
        where = "in space: give three components" if d == 3 else "plane: give two components"
        raise InputError(f"body {body.name!r} is {where} (got {list(vector)})", key)
    return np.array(vector, dtype=np.float64)


def space_force(
    body: AnyBody, equations: Equations, weights: FloatArray, force: FloatArray,
    amplitude: Amplitude,
) -> None:
    """Nodal weights (N,) times one force (d,) in space axes, N per unit weight."""
    if isinstance(body, SpatialBody):
        body.space_force(equations, weights, force, amplitude)
    else:
        body.space_force(equations, weights, complex(*force), amplitude)


def body_force(
    body: AnyBody, equations: Equations, forces: FloatArray, amplitude: Amplitude
) -> None:
    """Nodal forces (N, d) that turn with the body frame, N."""
    if isinstance(body, SpatialBody):
        body.body_force(equations, forces, amplitude)
    else:
        body.body_force(equations, forces[:, 0] + 1j * forces[:, 1], amplitude)


def weight(
    body: AnyBody, equations: Equations, g: FloatArray, amplitude: Amplitude
) -> None:
    """Weight of the deformed body under an acceleration g (d,), m/s^2."""
    if isinstance(body, SpatialBody):
        body.gravity(equations, g, amplitude)
    else:
        body.gravity(equations, complex(*g), amplitude)
