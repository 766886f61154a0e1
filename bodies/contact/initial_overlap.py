"""Check of the initial configuration: overlap of two bodies."""

import numpy as np

from sparsemor.bodies.body import FloatingBody
from sparsemor.bodies.contact.projection import nearest
from sparsemor.bodies.contact.surface import Surface
from sparsemor.core import BoolArray, FloatArray, InputError
from sparsemor.core.model.facets import linear_surface

OVERLAP = 0.1
"""Largest admissible initial penetration, as a fraction of the smallest facet of both surfaces."""
AT_ONCE = 2_000_000
"""Number of point-facet combinations evaluated together."""


def check_start(first: Surface, second: Surface) -> None:
    """Raises InputError (key `between`) if a node of either surface is inside the other body by
    more than `OVERLAP` times the smallest facet."""
    size = float(min(first.sizes.min(), second.sizes.min()))
    for one, other in ((first, second), (second, first)):
        found = _deepest(one, other, OVERLAP * size)
        if found is None:
            continue
        place = ", ".join(f"{x:.6g}" for x in found[0])
        a, b = one.body.name, other.body.name
        raise InputError(
            f"bodies {a!r} and {b!r} overlap at the start: a point of {a!r} at ({place}) m is "
            f"{found[1]:.3g} m below the surface of {b!r}, more than {OVERLAP:g} of the smallest "
            f"facet ({size:.3g} m); correct a pose", "between")


def _deepest(one: Surface, other: Surface, allowed: float) -> tuple[FloatArray, float] | None:
    """The node (d,) of `one` that is deepest inside the other body, m, and its depth, m; None if no
    depth exceeds `allowed`."""
    z = placed(one.body, one.X)
    z = z[_in_box(other.body, z)]
    if not len(z):
        return None
    depth = nearest(z, placed(other.body, other.X)[other.facets]).distance
    z, depth = z[depth > allowed], depth[depth > allowed]  # `within` looks at every facet
    inside = within(other.body, z)
    if not inside.any():
        return None
    worst = int(np.argmax(np.where(inside, depth, -1.0)))
    return z[worst], float(depth[worst])


def placed(body: FloatingBody, X: FloatArray) -> FloatArray:
    """(n, d) initial positions in space of reference points X (n, d), m."""
    return np.asarray(body.pose[: X.shape[1]] + X @ body.start_rotation().T)


def _in_box(body: FloatingBody, z: FloatArray) -> BoolArray:
    """(n,) True for points z (n, d) in space that are inside the body's bounding box, aligned with
    the body axes."""
    X = body.X
    own = (z - body.pose[: z.shape[1]]) @ body.start_rotation()
    return np.asarray(((own > X.min(axis=0)) & (own < X.max(axis=0))).all(axis=1))


def within(body: FloatingBody, z: FloatArray) -> BoolArray:
    """(n,) True for points z (n, d) in space inside the undeformed body in its initial pose: its
    boundary subtends the full (solid) angle there."""
    assert body.mesh is not None
    corners = placed(body, body.X)[linear_surface(body.mesh.nodes, body.d)]
    share = np.zeros(len(z))
    for part in np.array_split(np.arange(len(z)), 1 + len(z) * len(corners) // AT_ONCE):
        share[part] = _view(corners[None] - z[part, None, None]).sum(axis=1)
    return np.asarray(share > 0.5)


def _view(rays: FloatArray) -> FloatArray:
    """(n, F) signed fraction of the full angle that each facet subtends, from the vectors `rays`
    (n, F, d, d) to its corners.

    Angle over 2 pi in the plane, solid angle over 4 pi in space (Van Oosterom and Strackee,
    10.1109/TBME.1983.325207).
    """
    if rays.shape[3] == 2:
        a, b = rays[:, :, 0], rays[:, :, 1]
        across = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
        return np.asarray(np.arctan2(across, (a * b).sum(-1)) / (2.0 * np.pi))
    a, b, c = (rays[:, :, i] for i in range(3))
    p, q, r = (np.linalg.norm(x, axis=2) for x in (a, b, c))
    over = p * q * r + (a * b).sum(-1) * r + (b * c).sum(-1) * p + (c * a).sum(-1) * q
    return np.asarray(np.arctan2((a * np.cross(b, c)).sum(-1), over) / (2.0 * np.pi))
