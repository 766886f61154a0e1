"""Derivatives of the nodal forces and heats of a contact, in the second body's axes.

Notation of overlaps.py. Let y = sum s da - sum eta db - delta sum g (n . db) be the virtual
displacement of the first body's point relative to the second body's. With L = sum b' g^T and h =
L^T n = sum g (n . b'),

    d delta = -n . y,   d eta = g . y,   dn = -sum g (n . db),   dw = -L y + (n . y) h - delta dh

where dw is for constant nodal velocities. A force F = p (n - phi slip) depends on w, y and dn; its
nodal forces follow with the transpose of y. Where only the first surface moves, y = sum s da and
the other terms are zero.

Edges of overlaps that move where the tractions do not vanish add boundary terms (Leibniz rule).

W (M, k) are the weights of the k quadrature points of M pieces; y_by, n_by, h_by the derivatives of
y and n, and delta times that of h, by the D corner coordinates (`_moves`); traction and friction
heat depend on these by force_y, heat_y etc. (`Responses`), so that for positions

    d(heat) = heat_y . dy + heat_n . dn + heat_w . dw,     dw = ... - delta dh.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sparsemor.bodies.contact.clipping import NONE, Parts
from sparsemor.bodies.contact.overlaps import DEPTH, EDGE, Overlaps, Pieces
from sparsemor.bodies.contact.quadrature import points_along
from sparsemor.bodies.contact.surface import area_slopes
from sparsemor.bodies.contact.tractions import (
    ContactLoads,
    ContactSamples,
    Interface,
    drop,
    weights_of,
)
from sparsemor.bodies.fem.integrals import area_vectors
from sparsemor.core import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Tangent:
    """Derivatives of the nodal forces and heats of each of P overlaps of two facets.

    z, rate (P, D + 2 d, D): derivatives by the positions and by the velocities of the corners, in
    the second body's axes; rows: forces on the corners (D = d^2 where only the first surface moves,
    else 2 d^2), then heats (2 d). T (P, 2 d, 2 d): derivative of the heats by the corner
    temperatures, W/K.
    """

    z: FloatArray
    rate: FloatArray
    T: FloatArray

    @classmethod
    def from_overlaps(
        cls, o: Overlaps, pieces: Pieces, face: Interface, loads: ContactLoads,
        T: FloatArray | None, deforms: bool, warms: bool,
    ) -> "Tangent":
        """Derivatives for given overlaps, pieces and nodal loads; T (P, 2 d): corner temperatures,
        K.

        deforms: the traction may jump at every border of a cell; warms: compute the rows of the
        heats, which are zero otherwise. q: samples at the quadrature points of M pieces, W their
        weights; responses: derivatives of tractions and heats there. Besides these the area changes
        (`_measure`), and edges of overlaps move (`moving_edges`).
        """
        q = ContactSamples.at(o, pieces.overlap, pieces.samples(face.points), face)
        W = weights_of(o, pieces, face)
        responses = Responses.from_samples(o, q, face, T)
        first_only = o.pairs.vb is None  # the second surface does not deform
        # each a pair: derivatives by the positions and by the velocities
        forces = (_first_moves if first_only else _both_move)(o, q, W, responses)
        M, D = forces[0].shape[:2]
        heats = (np.zeros((M, 2 * o.d, D)),) * 2
        if warms:
            heats = (_warm_first if first_only else _warm_both)(o, q, W, responses, face)
        z, rate = (np.concatenate(x, axis=1) for x in zip(forces, heats, strict=True))
        # loads are proportional to the projected measure, which changes too
        whole = np.concatenate([loads.force.reshape(M, 2 * o.d**2)[:, :D], loads.heat], axis=1)
        z += whole[:, :, None] * (_measure(o)[:, :D] / o.measure[:, None])[q.of][:, None]
        by_z, by_rate = summed(z, q.of, len(o.at)), summed(rate, q.of, len(o.at))
        for of, jump in moving_edges(o, pieces, face, T, deforms):
            np.add.at(by_z, of, jump[:, :, :D])
        return cls(by_z, by_rate, _conduction(o, q, W, face))


def summed(values: FloatArray, of: IntArray, number: int) -> FloatArray:
    """(number, ...) sums of values (M, ...) over equal entries of `of` (M,), which is sorted."""
    made = np.zeros((number, *values.shape[1:]))
    if len(of):
        starts = np.flatnonzero(np.diff(of, prepend=-1))
        made[of[starts]] = np.add.reduceat(values, starts, axis=0)
    return made


@dataclass(frozen=True, slots=True, eq=False)
class Responses:
    """Tractions and heat fluxes at quadrature points (M, q), and their derivatives.

    force_y, force_w, force_n (M, q, d, d): derivatives of the traction on the first body by y, w
    and n; heat_y, heat_w, heat_n (M, q, d): of the friction heat; flow_y: of the conducted heat;
    force (M, q, d), Pa; heat, flow (M, q), W/m2.
    """

    force_y: FloatArray
    force_w: FloatArray
    force_n: FloatArray
    heat_y: FloatArray
    heat_w: FloatArray
    heat_n: FloatArray
    flow_y: FloatArray
    force: FloatArray
    heat: FloatArray
    flow: FloatArray

    @classmethod
    def from_samples(
        cls, o: Overlaps, q: ContactSamples, face: Interface, T: FloatArray | None
    ) -> "Responses":
        """Responses at quadrature points with traction p u, u = n - phi v - pull; v slip velocity,
        phi friction coefficient over speed, pull that of bristles; w relative velocity. T (P, 2 d):
        temperatures at the corners, K.

        dp = -p_depth n . dy - p_sink (n . dw + w . dn), v = w - (n . w) n, and the friction heat is
        p (ratio speed + pull . free) with the names of `ContactSamples`.
        """
        planes, vb = o.pairs.planes, o.pairs.vb
        n, v = planes.n[q.of][:, None], q.slip
        N, V = n[..., None, :], v[..., None, :]
        p, p_depth, p_sink, phi = (x[..., None] for x in (q.p, q.p_depth, q.p_sink, q.phi))
        u = n - phi * v - q.pull
        # d phi / d speed over the speed; whose square must not underflow
        moves = np.abs(q.speed) > 1e-100
        bend = np.where(moves, q.ratio_slip - q.phi, 0.0) / np.where(moves, q.speed, 1.0) ** 2
        eye = np.eye(o.d)
        drops = q.pull[..., None] * q.fall[..., None, :]  # of bristles, whose coefficient falls
        slides = p[..., None] * (phi[..., None] * eye + bend[..., None, None] * v[..., None] * V)
        across = eye - n[..., None] * N  # dv / dw
        # u dp + p du, du = -d(phi v) - d(pull)
        force_w = -u[..., None] * (p_sink * n)[..., None, :] - slides @ across - p[
            ..., None] * drops
        freed = (q.pull * q.free).sum(axis=2)[..., None]
        work = (q.ratio * q.speed)[..., None] + freed  # friction heat over pressure
        grip = p * (q.ratio_slip + q.phi)[..., None]
        heat_w = -p_sink * work * n + grip * v + p * (q.pull + freed * q.fall)
        force_y, heat_y = -u[..., None] * (p_depth * n)[..., None, :], -p_depth * work * n
        force_n, heat_n = np.zeros_like(force_y), np.zeros_like(heat_y)
        if vb is not None:
            w_by = _relative_velocity_by(vb, planes.g, planes.n)[q.of][:, None]
            force_y = force_y + force_w @ w_by
            heat_y = heat_y + (heat_w[..., None, :] @ w_by)[..., 0, :]
            off = -q.sink[..., None]  # n . w
            w = v + off * n
            force_n = -u[..., None] * (p_sink * w)[..., None, :] + p[..., None] * eye + slides @ (
                off[..., None] * eye + n[..., None] * w[..., None, :])
            heat_n = -p_sink * work * w - grip * off * v
            if q.bent is not None:  # pull is the tangential part of mu bent
                up, back = ((x * n).sum(axis=2)[..., None] for x in (q.bent, q.free))
                mu = q.mu[..., None]
                force_n = force_n + p[..., None] * (mu[..., None] * (
                    up[..., None] * eye + n[..., None] * q.bent[..., None, :])
                    + off[..., None] * drops)
                heat_n = heat_n - p * (mu * (up * q.free + (off + back) * q.bent)
                                       + off * freed * q.fall)
        flow, flow_y = np.zeros_like(q.p), np.zeros_like(v)
        if T is not None and face.conductance > 0:
            flow = face.conductance * drop(q, T)
            slope = (T[:, None, o.d :] @ planes.g)[q.of]
            flow_y = flow_y - face.conductance * slope
        return cls(force_y, force_w, force_n, heat_y, heat_w, heat_n, flow_y, force=p * u,
                   heat=q.power(), flow=flow)


def _relative_velocity_by(vb: FloatArray, g: FloatArray, n: FloatArray) -> FloatArray:
    """(P, d, d) derivative -L + h n^T of the relative velocity w by y, for a constant h (module
    docstring); vb (P, d, d): velocities of the second facet's corners, m/s."""
    L = vb.transpose(0, 2, 1) @ g
    h = L.transpose(0, 2, 1) @ n[:, :, None]
    return np.asarray(h * n[:, None] - L)


def _measure(o: Overlaps) -> FloatArray:
    """(P, 2 d^2) derivative of the projected measure (`Pairs.measure`) by the corners of both
    facets."""
    a, n, g = o.pairs.a, o.pairs.planes.n, o.pairs.planes.g
    first = -area_slopes(a, n)
    second = (g @ area_vectors(a)[:, :, None]) * n[:, None]
    return np.concatenate([first, second], axis=1).reshape(len(a), -1)


def _first_moves(
    o: Overlaps, q: ContactSamples, W: FloatArray, of: Responses
) -> tuple[FloatArray, FloatArray]:
    """Derivatives (M, d^2, d^2) of the nodal forces by positions and by velocities of the first
    facet's corners, for M pieces with k points of weights W (M, k). The relative displacement y,
    and its rate w, are sums of those of the corners with the shape functions s; force_y, force_w:
    derivatives of the traction by these."""
    (M, k), d, D = W.shape, o.d, o.d**2
    # y = sum s da: the force on corner i by corner j is sum over points of W s_i s_j dF/dy
    shapes = (q.s[..., :, None] * q.s[..., None, :]).reshape(M, k, D) * W[..., None]
    found = []
    for force in (of.force_y, of.force_w):
        by = shapes.transpose(0, 2, 1) @ force.reshape(M, k, D)  # (corner i, corner j; a, b)
        found.append(by.reshape(M, d, d, d, d).transpose(0, 1, 3, 2, 4).reshape(M, D, D))
    return found[0], found[1]


def _warm_first(
    o: Overlaps, q: ContactSamples, W: FloatArray, of: Responses, face: Interface
) -> tuple[FloatArray, FloatArray]:
    """Derivatives (M, 2 d, d^2) of the nodal heats of both facets by positions and by velocities of
    the first facet's corners. y, w: relative displacement and velocity of a point, sums over these
    corners with the shape functions s; heat_y, heat_w, flow_y: derivatives of friction heat and
    conducted heat by these; face.share: fraction of friction heat into the first body."""
    (M, k), d = W.shape, o.d

    def columns(by: FloatArray) -> FloatArray:
        """(M, k, D) weighted derivative by the corners, of one by y or w (M, k, d)."""
        return (q.s[..., :, None] * by[..., None, :]).reshape(M, k, d**2) * W[..., None]

    by_z = _heats(q, columns(of.heat_y), face.share) + _conducted(q, columns(of.flow_y))
    # the heat of a point moves over the second facet: its shape functions eta change by y; moved
    # (M, k, corner of the second facet, component of y)
    moved = _carried(o, q, of, face.share) * W[..., None, None]
    by_z[:, d:] += np.einsum("mqja,mqi->mjia", moved, q.s).reshape(M, d, d**2)
    return by_z, _heats(q, columns(of.heat_w), face.share)


def _heats(q: ContactSamples, columns: FloatArray, share: float) -> FloatArray:
    """(M, 2 d, D) derivative of the nodal friction heats, from the derivative of the friction heat
    at quadrature points, columns (M, q, D), weighted.

    share: fraction that enters the first body.
    """
    return np.concatenate([share * (q.s.transpose(0, 2, 1) @ columns),
                           (1.0 - share) * (q.eta.transpose(0, 2, 1) @ columns)], axis=1)


def _conducted(q: ContactSamples, columns: FloatArray) -> FloatArray:
    """(M, 2 d, D) derivative of the nodal conducted heats, which leave the first facet and enter
    the second, from that at quadrature points, columns (M, q, D), weighted."""
    return np.concatenate([-(q.s.transpose(0, 2, 1) @ columns),
                           q.eta.transpose(0, 2, 1) @ columns], axis=1)


def _carried(o: Overlaps, q: ContactSamples, of: Responses, share: float) -> FloatArray:
    """(M, q, d, d) derivative by y of the heat at the second facet's corners through its shape
    functions eta: d eta = g . y."""
    into = (1.0 - share) * of.heat + of.flow
    return np.asarray(into[..., None, None] * o.pairs.planes.g[q.of][:, None])


def _displacement(o: Overlaps, q: ContactSamples) -> FloatArray:
    """(M, q, d, 2 d^2) derivative of y by the corners of both facets, dy = sum s da - sum eta db -
    delta sum g (n . db)."""
    n, g = o.pairs.planes.n[q.of], o.pairs.planes.g[q.of]
    eye = np.eye(o.d)
    first = q.s[..., None, :, None] * eye[:, None]
    normal_turn = g.transpose(0, 2, 1)[..., None] * n[:, None, None]  # (M, a, k, b)
    second = -(q.eta[..., None, :, None] * eye[:, None]
               + q.depth[..., None, None, None] * normal_turn[:, None])
    return np.concatenate([first, second], axis=3).reshape(*q.p.shape, o.d, -1)


def _both_move(
    o: Overlaps, q: ContactSamples, W: FloatArray, of: Responses
) -> tuple[FloatArray, FloatArray]:
    """Derivatives (M, 2 d^2, 2 d^2) of the nodal forces by positions and by velocities of both
    facets' corners: of the traction by relative displacement y, normal n and relative velocity w,
    times the derivatives y_by, n_by and h_by, (M, 1 or k, d, D), by D = 2 d^2 coordinates of
    corners. w contains -delta h with the penetration delta and h = sum g (n . b'), minus the rate
    of the second facet's normal; h_by: delta dh. W (M, k): weights."""
    y_by, n_by, h_by = _moves(o, q)
    (M, k), d, D = W.shape, o.d, y_by.shape[3]
    by_z = of.force_y @ y_by + of.force_n @ n_by - of.force_w @ h_by
    # nodal forces are y_by^T F, of which the weights y_by change as well (`_bent`)
    back = (W[..., None, None] * y_by).transpose(0, 3, 1, 2).reshape(M, D, d * k)
    at_corners, by_rate = (back @ x.reshape(M, d * k, D) for x in (by_z, of.force_w @ y_by))
    return at_corners + _bent(o, q, W, of, y_by, n_by), by_rate


def _warm_both(
    o: Overlaps, q: ContactSamples, W: FloatArray, of: Responses, face: Interface
) -> tuple[FloatArray, FloatArray]:
    """Derivatives (M, 2 d, 2 d^2) of the nodal heats by positions and by velocities of both facets'
    corners: of friction heat (heat_) and conducted heat (flow_) by relative displacement y, normal
    n and relative velocity w, times the derivatives y_by, n_by and h_by, (M, 1 or k, d, D), by D =
    2 d^2 coordinates of corners. w contains -delta h with the penetration delta and h = sum g (n .
    b'), minus the rate of the second facet's normal; h_by: delta dh. W (M, k): weights."""
    y_by, n_by, h_by = _moves(o, q)

    def columns(by: FloatArray, variable_by: FloatArray) -> FloatArray:
        """(M, k, D) weighted derivative by the corners: by a variable, times that of the
        variable."""
        return W[..., None] * (by[..., None, :] @ variable_by)[..., 0, :]

    heat = columns(of.heat_y, y_by) + columns(of.heat_n, n_by) - columns(of.heat_w, h_by)
    by_z = _heats(q, heat, face.share) + _conducted(q, columns(of.flow_y, y_by))
    # the heat of a point moves over the second facet: its shape functions eta change
    by_z[:, o.d :] += (W[..., None, None] * (_carried(o, q, of, face.share) @ y_by)).sum(axis=1)
    return by_z, _heats(q, columns(of.heat_w, y_by), face.share)


def _moves(o: Overlaps, q: ContactSamples) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Derivatives of y (M, q, d, D), of n (M, 1, d, D) and delta times that of h (M, q, d, D), by
    both facets' corners."""
    tilt, swing = (x[q.of][:, None] for x in tilts(o))
    return _displacement(o, q), tilt, q.depth[..., None, None] * swing


def tilts(o: Overlaps) -> tuple[FloatArray, FloatArray]:
    """Derivatives (P, d, 2 d^2) of the second facet's normal, dn = -sum g (n . db), and of h = sum
    g (n . b') = L^T n, L = sum b' g^T, by the corners a, b of both facets, of which the first d^2
    (a) have no effect; b' (vb): velocities of b, held constant; g: gradients of its barycentric
    coordinates."""
    n, g, vb = o.pairs.planes.n, o.pairs.planes.g, o.pairs.vb
    assert vb is not None
    P, d, D = len(n), o.d, o.d**2
    tilt, swing = np.zeros((P, d, 2 * D)), np.zeros((P, d, 2 * D))
    tilt[:, :, D:] = -(g.transpose(0, 2, 1)[..., None] * n[:, None, None]).reshape(P, d, D)
    L = vb.transpose(0, 2, 1) @ g
    h = (L.transpose(0, 2, 1) @ n[:, :, None])[:, :, 0]
    # dh = sum dg_j (n . b'_j) + L^T dn with dg_j = -sum g_k (g_j . db_k) - n (g_j . dn)
    swing[:, :, D:] = -(g.transpose(0, 2, 1)[..., None] * h[:, None, None]).reshape(P, d, D)
    swing += (L.transpose(0, 2, 1) - n[:, :, None] * h[:, None]) @ tilt
    return tilt, swing


def _bent(
    o: Overlaps, q: ContactSamples, W: FloatArray, of: Responses, B: FloatArray, tilt: FloatArray
) -> FloatArray:
    """(M, 2 d^2, 2 d^2) derivative of the nodal forces for a constant traction F, which are -(eta F
    + delta (g . F) n) at the second facet's corners; rows of the first facet are zero (s F).

    B (M, q, d, 2 d^2), tilt (M, 1, d, 2 d^2): derivatives of the relative displacement y and of n,
    which is the same at all points, by the coordinates of the corners of both facets (`_moves`): d
    eta = g . y, d delta = -n . y; W (M, q): weights; q.depth = delta, of.force = F.
    """
    n, g = o.pairs.planes.n[q.of], o.pairs.planes.g[q.of]
    F = W[..., None] * of.force
    M, d, D = len(W), o.d, o.d**2
    gF, nF = (F @ g.transpose(0, 2, 1)), (F @ n[:, :, None])[..., 0]  # (M, q, d), (M, q)
    gB = g[:, None] @ B  # (M, q, d, D): d eta
    found = np.zeros((M, 2 * D, 2 * D))
    second = found[:, D:].reshape(M, d, d, 2 * D)  # corner j, axis a of the force, column c
    second -= np.einsum("mqa,mqjc->mjac", F, gB)  # -d eta F
    nB = (n[:, None, None] @ B)[..., 0, :]
    # -d delta (g . F) n with d delta = -n . y
    second += (gF.transpose(0, 2, 1) @ nB)[:, :, None] * n[:, None, :, None]
    arm = (q.depth[..., None] * gF).sum(axis=1)
    up = (q.depth * nF).sum(axis=1)
    t = tilt[:, 0]
    # -delta (dg . F) n with dg = -sum g (g_j . db) - n (g_j . dn), then -delta (g . F) dn
    by_b = np.zeros((M, d, 2 * D))
    by_b[:, :, D:] = (arm[:, None, :, None] * g[:, :, None]).reshape(M, d, D)
    by_b += up[:, None, None] * (g @ t)
    second += by_b[:, :, None] * n[:, None, :, None]
    second -= arm[:, :, None, None] * t[:, None]
    found[:, D:] = second.reshape(M, D, 2 * D)
    return found


def _conduction(o: Overlaps, q: ContactSamples, W: FloatArray, face: Interface) -> FloatArray:
    """(P, 2 d, 2 d) derivative of the nodal conducted heats by the corner temperatures, W/K."""
    if face.conductance == 0.0:
        return np.zeros((len(o.at), 2 * o.d, 2 * o.d))
    g = np.concatenate([q.s, -q.eta], axis=2)
    local = -face.conductance * ((g * W[..., None]).transpose(0, 2, 1) @ g)
    return summed(local, q.of, len(o.at))


def moving_edges(
    o: Overlaps, pieces: Pieces, face: Interface, T: FloatArray | None, deforms: bool
) -> Iterator[tuple[IntArray, FloatArray]]:
    """Boundary contributions to `Tangent.z`: the integrand times the normal velocity of the edge
    (Leibniz rule).

    Yields overlap numbers (E,) and derivatives (E, rows, columns). Edges: borders of cells where
    the traction may jump (all borders if `deforms`) and, with conduction, the line of lift-off. T
    (P, 2 d): temperatures at the corners, K. tag: of an edge, the number of the cell's border on
    which it lies, `EDGE` for lift-off, `NONE` for the facet's own edge or one between pieces.
    """
    conducts = T is not None and face.conductance > 0
    tags = np.where(pieces.parts.used, pieces.parts.edges, NONE)
    piece, k = np.nonzero(tags != NONE)
    tag, of = tags[piece, k], pieces.of[piece]
    lifts = tag == EDGE  # has no border of the cell: 0 stands in for one
    jumps = o.pairs.cells.jumps[of, np.where(lifts, 0, tag)] | deforms
    wanted = np.where(lifts, conducts, jumps)
    piece, k, tag, of = (x[wanted] for x in (piece, k, tag, of))
    if not len(of):
        return
    s, weights = _rule(pieces.parts, piece, k, points_along(o.d, face.points) + 1)
    q = ContactSamples.at(o, of, s, face)
    W = (face.width * o.measure[of])[:, None] * weights
    both = o.pairs.vb is not None
    loads, speeds = _integrand(o, q, face, T, both), _velocity(o, q, tag, both)
    yield of, (W[..., None] * loads).transpose(0, 2, 1) @ speeds


def _rule(
    parts: Parts, piece: IntArray, k: IntArray, n: int
) -> tuple[FloatArray, FloatArray]:
    """Quadrature points (E, q, d), barycentric, and weights (E, q) on edges k (E,) of parts `piece`
    (E,): n Gauss points on the edge from corner k to the next, in the plane the end point itself.
    Weights have the sum of the edge's length in the first two barycentric coordinates."""
    start = parts.corners[piece, k]
    if start.shape[1] == 2:
        return start[:, None], np.ones((len(k), 1))
    stop = parts.corners[piece, parts.following()[piece, k]]
    x, w = np.polynomial.legendre.leggauss(n)
    s = start[:, None] + (0.5 * (x + 1.0))[:, None] * (stop - start)[:, None]
    length = np.linalg.norm((stop - start)[:, :2], axis=1)
    return s, 0.5 * length[:, None] * w


def _integrand(
    o: Overlaps, q: ContactSamples, face: Interface, T: FloatArray | None, both: bool
) -> FloatArray:
    """(E, q, D + 2 d) nodal forces per area, Pa, on the corners of the first facet (of both facets
    if `both`), and heats per area, W/m2, in the order of the rows of `Tangent.z`; T (P, 2 d):
    temperatures at the corners, K.

    A traction F = p n + drag gives s F on the first facet, -(eta F + delta (g . F) n) on the
    second. Heat: share and 1 - share of the friction power, and conduction from the first to the
    second; drop: temperature of the first surface minus that of the second, K.
    """
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


def _velocity(o: Overlaps, q: ContactSamples, tag: IntArray, both: bool) -> FloatArray:
    """(E, q, D) outward normal velocity of the edge in barycentric coordinates, per velocity of
    each corner coordinate: of the first facet's corners, then, if `both`, of the second's.

    tag (E,): border of the cell on which an edge lies, or `EDGE`. On the edge a function `bound` is
    zero, which is positive in the overlap: the penetration, or the border function of the cell,
    border . eta - depth_slope depth (`FacetCells`). It moves with the speed grad(bound) . y /
    |grad(bound)|, the latter by barycentric coordinates. o.at: values at the first facet's corners,
    with the columns DEPTH and eta.
    """
    n, g, cells = o.pairs.planes.n[q.of], o.pairs.planes.g[q.of], o.pairs.cells
    lifts = (tag == EDGE)[:, None]
    at = q.of, np.where(lifts[:, 0], 0, tag)  # border 0 stands in where the surfaces lift off
    border, depth_slope = cells.borders[at], cells.depth_slopes[at][:, None]
    depth, eta = o.at[q.of, :, DEPTH], o.at[q.of, :, o.eta_columns]
    bound = np.where(lifts, depth, (eta @ border[:, :, None])[:, :, 0] - depth_slope * depth)
    gradient = np.where(lifts, -n, (border[:, None] @ g)[:, 0] + depth_slope * n)
    # |grad(bound)| by the first d - 1 barycentric coordinates, the last is 1 less their sum
    slope = np.linalg.norm(bound[:, :-1] - bound[:, -1:], axis=1)
    normal = gradient / slope[:, None]
    shape = (*q.p.shape, o.d**2)
    first = (q.s[..., None] * normal[:, None, None]).reshape(shape)
    if not both:
        return np.asarray(first)
    # dy = s . da - eta . db + delta dn, with dn = -sum g (n . db)
    normal_turn = (g @ normal[:, :, None]) * n[:, None]
    second = -(q.eta[..., None] * normal[:, None, None]
               + q.depth[..., None, None] * normal_turn[:, None])
    # in the plane a border keeps its angle (`Surface.cells_at`): its inclination by eta, of the
    # unit 1/m, changes with the length of the segment, d depth_slope = -depth_slope sum g . db
    if o.d == 2:
        by = np.where(lifts, 0.0, depth_slope) * q.depth / slope[:, None]
        second += by[..., None, None] * g[:, None]
    return np.concatenate([first, second.reshape(shape)], axis=2)
