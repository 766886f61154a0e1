"""Whether two surfaces can begin as they are placed."""

from collections.abc import Callable
from typing import Any, TypeAlias, TypeVar

import numpy as np

from sparsemor.bodies.body_part import PlanarBody
from sparsemor.bodies.contact.facets import Facets
from sparsemor.bodies.contact.projection import nearest
from sparsemor.bodies.contact.surface import Surface, plane
from sparsemor.bodies.mesh.simplices import boundary
from sparsemor.bodies.planar.motion import ComplexArray
from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.errors import InputError

S = TypeVar("S", bound=Facets[Any])
OVERLAP = 0.1
"""Largest penetration at the start, as a share of the smallest facet of both surfaces."""


Deepest: TypeAlias = Callable[[S, S, float], tuple[FloatArray, float] | None]
"""(one, other, allowed) -> the point (d,) of the surface `one` that is deepest inside the other
body, and its depth, m; None where none is deeper than allowed."""


def check_start(first: S, second: S, deepest: Deepest[S]) -> None:
    """InputError (key `between`) when a point of either surface is inside the other body by more
    than `OVERLAP` of the smallest facet."""
    size = float(min(first.sizes.min(), second.sizes.min()))
    for one, other in ((first, second), (second, first)):
        found = deepest(one, other, OVERLAP * size)
        if found is None:
            continue
        place = ", ".join(f"{x:.6g}" for x in found[0])
        a, b = one.body.name, other.body.name
        raise InputError(
            f"bodies {a!r} and {b!r} overlap at the start: a point of {a!r} at ({place}) m is "
            f"{found[1]:.3g} m below the surface of {b!r}, more than {OVERLAP:g} of the smallest "
            f"facet ({size:.3g} m); correct a pose", "between")


def deepest(one: Surface, other: Surface, allowed: float) -> tuple[FloatArray, float] | None:
    """See `Deepest`, in the plane."""
    z = placed(one.body, one.X)
    z = z[within(other.body, z)]
    if not len(z):
        return None
    depth = distance(z, other)
    worst = int(np.argmax(depth))
    return (plane(z[worst]), float(depth[worst])) if depth[worst] > allowed else None


def placed(body: PlanarBody, X: ComplexArray) -> ComplexArray:
    """Positions at the start of reference points X (n,), m."""
    x, y, angle = (float(c) for c in body.pose)
    return np.asarray(complex(x, y) + np.exp(1j * angle) * X)


def within(body: PlanarBody, z: ComplexArray) -> BoolArray:
    """(n,) which points z (n,) in space are inside the undeformed body at the start: the outline
    winds around them."""
    assert body.mesh is not None
    ends = placed(body, body.X)[boundary(body.mesh)]
    ratio = (ends[None, :, 1] - z[:, None]) / np.where(
        ends[None, :, 0] == z[:, None], 1.0, ends[None, :, 0] - z[:, None])
    return np.asarray(np.angle(ratio).sum(axis=1) > np.pi)


def distance(z: ComplexArray, surface: Surface) -> FloatArray:
    """(n,) distance of points z (n,) from the surface at the start, m."""
    corners = plane(placed(surface.body, surface.X))[surface.facets]
    return nearest(plane(z), corners).distance
