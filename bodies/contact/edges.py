"""Boundary terms of the contact derivatives (Leibniz rule): edges of overlaps that move where the
tractions do not vanish."""

from collections.abc import Iterator

import numpy as np

from sparsemor.bodies.contact.clipping import Parts
from sparsemor.bodies.contact.pieces import DEPTH, EDGE, Overlaps, Pieces
from sparsemor.bodies.contact.quadrature import points_along
from sparsemor.bodies.contact.tractions import Interface, Samples, drop
from sparsemor.core import FloatArray, IntArray


def moving_edges(
    o: Overlaps, pieces: Pieces, face: Interface, T: FloatArray | None, deforms: bool
) -> Iterator[tuple[IntArray, FloatArray]]:
    """Boundary contributions to `Tangent.z`: the integrand times the normal velocity of the edge
    (Leibniz rule).

    Yields overlap numbers (E,) and derivatives (E, rows, columns). Edges: borders of cells where
    the traction may jump (all borders if `deforms`) and, with conduction, the line of lift-off. T
    (P, 2 d): temperatures at the corners, K.
    """
    conducts = T is not None and face.conductance > 0
    tags = np.where(pieces.parts.used, pieces.parts.edges, -1)
    piece, k = np.nonzero(tags >= 0)
    tag, of = tags[piece, k], pieces.of[piece]
    lifts = tag == EDGE
    jumps = o.pairs.cells.jumps[of, np.where(lifts, 0, tag)] | deforms
    wanted = np.where(lifts, conducts, jumps)
    piece, k, tag, of = (x[wanted] for x in (piece, k, tag, of))
    if not len(of):
        return
    s, weights = _rule(pieces.parts, piece, k, points_along(o.d, face.points) + 1)
    q = Samples.at(o, of, s, face)
    W = (face.width * o.measure[of])[:, None] * weights
    both = o.pairs.vb is not None
    yield of, (W[..., None] * _integrand(o, q, face, T, both)).transpose(0, 2, 1) @ _velocity(
        o, q, tag, both)


def _rule(
    parts: Parts, piece: IntArray, k: IntArray, n: int
) -> tuple[FloatArray, FloatArray]:
    """Quadrature points (E, q, d), barycentric, and weights (E, q) on edges k (E,) of parts `piece`
    (E,): n Gauss points on each edge, in the plane the end point itself."""
    start = parts.corners[piece, k]
    if start.shape[1] == 2:
        return start[:, None], np.ones((len(k), 1))
    stop = parts.corners[piece, parts.following()[piece, k]]
    x, w = np.polynomial.legendre.leggauss(n)
    s = start[:, None] + (0.5 * (x + 1.0))[:, None] * (stop - start)[:, None]
    length = np.linalg.norm((stop - start)[:, :2], axis=1)
    return s, 0.5 * length[:, None] * w


def _integrand(
    o: Overlaps, q: Samples, face: Interface, T: FloatArray | None, both: bool
) -> FloatArray:
    """(E, q, D + 2 d) nodal forces per area on the corners of the first facet (of both facets if
    `both`), and heats per area."""
    n, g = o.pairs.planes.n[q.of], o.pairs.planes.g[q.of]
    F = q.p[..., None] * n[:, None] + q.drag()
    shape = (*q.p.shape, o.d**2)
    parts = [(q.s[..., None] * F[..., None, :]).reshape(shape)]
    if both:
        lift = (q.depth[..., None] * (q.drag() @ g.transpose(0, 2, 1)))[..., None] * n[
            :, None, None]
        parts.append(-(q.eta[..., None] * F[..., None, :] + lift).reshape(shape))
    heat, share = q.power()[..., None], face.share
    flow = np.zeros_like(heat)
    if T is not None and face.conductance > 0:
        flow = face.conductance * drop(q, T)[..., None]
    parts += [q.s * (share * heat - flow), q.eta * ((1.0 - share) * heat + flow)]
    return np.concatenate(parts, axis=2)


def _velocity(o: Overlaps, q: Samples, tag: IntArray, both: bool) -> FloatArray:
    """(E, q, D) outward normal velocity of the edge in barycentric coordinates, per velocity of
    each corner coordinate."""
    n, g, cells = o.pairs.planes.n[q.of], o.pairs.planes.g[q.of], o.pairs.cells
    lifts = (tag == EDGE)[:, None]
    at = q.of, np.where(lifts[:, 0], 0, tag)
    border, lean_by = cells.borders[at], cells.leans[at][:, None]
    depth, eta = o.at[q.of, :, DEPTH], o.at[q.of, :, 2 + o.d :]
    bound = np.where(lifts, depth, (eta @ border[:, :, None])[:, :, 0] - lean_by * depth)
    normal = np.where(lifts, -n, (border[:, None] @ g)[:, 0] + lean_by * n)
    slope = np.linalg.norm(bound[:, :-1] - bound[:, -1:], axis=1)
    normal = normal / slope[:, None]
    shape = (*q.p.shape, o.d**2)
    first = (q.s[..., None] * normal[:, None, None]).reshape(shape)
    if not both:
        return np.asarray(first)
    lean = (g @ normal[:, :, None]) * n[:, None]
    second = -(q.eta[..., None] * normal[:, None, None] + q.depth[..., None, None] * lean[:, None])
    if o.d == 2:  # a border that keeps its angle: d lean = -lean sum g . db
        by = np.where(lifts, 0.0, lean_by) * q.depth / slope[:, None]
        second += by[..., None, None] * g[:, None]
    return np.concatenate([first, second.reshape(shape)], axis=2)
