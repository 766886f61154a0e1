"""Whether two surfaces can begin as they are placed."""

from typing import NoReturn

import numpy as np

from sparsemor.bodies.body_part import PlanarBody
from sparsemor.bodies.contact.projection import nearest
from sparsemor.bodies.contact.surface import Surface, plane
from sparsemor.bodies.mesh.simplices import boundary
from sparsemor.bodies.planar.motion import ComplexArray
from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.errors import InputError

OVERLAP = 0.1
"""Largest penetration at the start, as a share of the smallest facet of both surfaces."""


def check_start(first: Surface, second: Surface) -> None:
    """InputError (key `between`) when a point of either surface is inside the other body by more
    than `OVERLAP` of the smallest facet."""
    size = float(min(first.sizes.min(), second.sizes.min()))
    for one, other in ((first, second), (second, first)):
        z = placed(one.body, one.X)
        inside = np.flatnonzero(within(other.body, z))
        if not len(inside):
            continue
        depth = distance(z[inside], other)
        worst = int(np.argmax(depth))
        if depth[worst] > OVERLAP * size:
            at = z[inside[worst]]
            overlapping(one.body.name, other.body.name, np.array([at.real, at.imag]),
                        float(depth[worst]), size)


def overlapping(one: str, other: str, at: FloatArray, depth: float, size: float) -> NoReturn:
    """InputError: a point of body `one` at (d,) is `depth` below the surface of `other`, in m."""
    place = ", ".join(f"{x:.6g}" for x in at)
    raise InputError(
        f"bodies {one!r} and {other!r} overlap at the start: a point of {one!r} at ({place}) m is "
        f"{depth:.3g} m below the surface of {other!r}, more than {OVERLAP:g} of the smallest "
        f"facet ({size:.3g} m); correct a pose", "between")


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
