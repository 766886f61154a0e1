"""What moving edges of overlaps add to derivatives, where tractions do not vanish there."""

from collections.abc import Iterator

import numpy as np

from sparsemor.bodies.contact.spatial.pieces import DEPTH, EDGE, ETA, Overlaps, Pieces
from sparsemor.bodies.contact.spatial.tractions import Samples, drop
from sparsemor.bodies.contact.tractions import Interface
from sparsemor.core.arrays import FloatArray, IntArray


def moving_edges(
    o: Overlaps, pieces: Pieces, face: Interface, T: FloatArray | None, deforms: bool
) -> Iterator[tuple[IntArray, FloatArray]]:
    """Overlaps (E,) and derivatives (E, rows, columns) of `Slopes.z`: the integrand times the
    velocity of the edge (Leibniz), along borders of cells where they may jump (all, where surfaces
    deform) and, for conduction, along the line of lift-off."""
    conducts = T is not None and face.conductance > 0
    polygons = pieces.polygons
    tag = np.where(polygons.used, polygons.edges, -1)
    piece, k = np.nonzero(tag >= 0)
    tag, of = tag[piece, k], pieces.of[piece]
    lifts = tag == EDGE
    jumps = o.pairs.cells.jumps[of, np.where(lifts, 0, tag)] | deforms
    wanted = np.where(lifts, conducts, jumps)
    piece, k, tag, of = (x[wanted] for x in (piece, k, tag, of))
    if not len(of):
        return
    start, stop = (polygons.places[piece, i] for i in (k, polygons.following()[piece, k]))
    x, w = np.polynomial.legendre.leggauss(round(len(face.weights) ** 0.5) + 1)
    s = start[:, None] + (0.5 * (x + 1.0))[:, None] * (stop - start)[:, None]
    length = np.linalg.norm((stop - start)[:, :2], axis=1)
    q = Samples.at(o, of, s, face)
    W = 0.5 * (length * o.measure[of])[:, None] * w
    D = 9 if o.pairs.vb is None else 18
    yield of, (W[..., None] * _integrand(o, q, face, T, D)).transpose(0, 2, 1) @ _velocity(
        o, q, tag, D)


def _integrand(
    o: Overlaps, q: Samples, face: Interface, T: FloatArray | None, D: int
) -> FloatArray:
    """(E, q, D + 6) forces on the corners and heats, per area."""
    n, g = o.pairs.planes.n[q.of], o.pairs.planes.g[q.of]
    F = q.p[..., None] * n[:, None] + q.drag()
    shape = (*q.p.shape, 9)
    parts = [(q.s[..., None] * F[..., None, :]).reshape(shape)]
    if D == 18:
        lift = (q.depth[..., None] * (q.drag() @ g.transpose(0, 2, 1)))[..., None] * n[
            :, None, None]
        parts.append(-(q.eta[..., None] * F[..., None, :] + lift).reshape(shape))
    heat, share = q.power()[..., None], face.share
    flow = np.zeros_like(heat)
    if T is not None and face.conductance > 0:
        flow = face.conductance * drop(q, T)[..., None]
    parts += [q.s * (share * heat - flow), q.eta * ((1.0 - share) * heat + flow)]
    return np.concatenate(parts, axis=2)


def _velocity(o: Overlaps, q: Samples, tag: IntArray, D: int) -> FloatArray:
    """(E, q, D): how far the edge moves outwards, in barycentric numbers, by the corners."""
    n, g, cells = o.pairs.planes.n[q.of], o.pairs.planes.g[q.of], o.pairs.cells
    lifts = (tag == EDGE)[:, None]
    at = q.of, np.where(lifts[:, 0], 0, tag)
    border, lean_by = cells.borders[at], cells.leans[at][:, None]
    depth = o.at[q.of][:, :, DEPTH]
    bound = np.where(lifts, depth,
                     (o.at[q.of][:, :, ETA] @ border[:, :, None])[:, :, 0] - lean_by * depth)
    normal = np.where(lifts, -n, (border[:, None] @ g)[:, 0] + lean_by * n)
    slope = np.linalg.norm(bound[:, :2] - bound[:, 2:], axis=1)
    normal = normal / slope[:, None]
    shape = (*q.p.shape, 9)
    first = (q.s[..., None] * normal[:, None, None]).reshape(shape)
    if D == 9:
        return np.asarray(first)
    lean = (g @ normal[:, :, None]) * n[:, None]
    second = -(q.eta[..., None] * normal[:, None, None] + q.depth[..., None, None] * lean[:, None])
    return np.concatenate([first, second.reshape(shape)], axis=2)
