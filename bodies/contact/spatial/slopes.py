"""Derivatives of the nodal forces and heats of a contact in space, in the second body's axes.

With y = sum s da - sum eta db - d sum g (n . db), the virtual displacement of the first body's
point against the second body's, everything follows from a few rules (w, h, L: see below):

    dd = -n . y,   d eta = g . y,   dn = -sum g (n . db),
    dw = -L y + (n . y) h - d dh   with w at rest, L = sum b' g^T, h = L^T n = sum g (n . b').

A force F = p (n - phi slip) acts on w, on y and on dn; it is brought to the corners by the
transpose of y. Where only the first surface moves, y = sum s da and the rest is zero.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sparsemor.bodies.contact.spatial.edges import moving_edges
from sparsemor.bodies.contact.spatial.pieces import Overlaps, Pieces
from sparsemor.bodies.contact.spatial.tractions import Loads, Samples, drop, weights_of
from sparsemor.bodies.contact.tractions import Interface
from sparsemor.core.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Slopes:
    """Of each overlap, rows being forces on the corners (9 where only the first surface moves,
    else 18), then heats (6): by position z and by velocity rate (P, D + 6, D), by temperature T
    (P, 6, 6) of the heats."""

    z: FloatArray
    rate: FloatArray
    T: FloatArray

    @classmethod
    def of(
        cls, o: Overlaps, pieces: Pieces, face: Interface, loads: Loads, T: FloatArray | None,
        deforms: bool, warms: bool,
    ) -> "Slopes":
        """deforms: the traction may jump at every border of a cell; warms: rows of heats are asked
        for, which are else zero."""
        q = Samples.at(o, pieces.overlap, pieces.samples(face.points), face)
        W = weights_of(o, pieces, face)
        answers = Answers.of(o, q, face, T)
        moves, warm = (_first_moves, _warm_first) if o.pairs.vb is None else (
            _both_move, _warm_both)
        forces = moves(o, q, W, answers)
        D = forces[0].shape[2]
        heats = warm(o, q, W, answers, face) if warms else (np.zeros((len(W), 6, D)),) * 2
        z, rate = (np.concatenate(x, axis=1) for x in zip(forces, heats, strict=True))
        whole = np.concatenate([loads.force.reshape(len(W), 18)[:, :D], loads.heat], axis=1)
        z += whole[:, :, None] * (_measure(o)[:, :D] / o.measure[:, None])[q.of][:, None]
        sums = csr_array((np.ones(len(W)), (q.of, np.arange(len(W)))), shape=(len(o.at), len(W)))
        by_z, by_rate = (np.asarray(sums @ x.reshape(len(W), -1)).reshape(-1, D + 6, D)
                         for x in (z, rate))
        for of, jump in moving_edges(o, pieces, face, T, deforms):
            np.add.at(by_z, of, jump[:, :, :D])
        return cls(by_z, by_rate, _conduction(o, q, W, face, sums))


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """Per area, at points (M, q): force on the first body by y, by w and by dn (3, 3); friction
    heat and conducted heat by them (3); the force, the friction heat, the heat that flows."""

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
    def of(cls, o: Overlaps, q: Samples, face: Interface, T: FloatArray | None) -> "Answers":
        planes, vb = o.pairs.planes, o.pairs.vb
        n, v = planes.n[q.of][:, None], q.slip
        N, V = n[..., None, :], v[..., None, :]
        p, p_depth, p_sink, phi = (x[..., None] for x in (q.p, q.p_depth, q.p_sink, q.phi))
        u = n - phi * v
        # d phi / d speed over the speed; whose square must not underflow
        moves = q.speed > 1e-100
        bend = np.where(moves, q.ratio_slip - q.phi, 0.0) / np.where(moves, q.speed, 1.0) ** 2
        eye = np.eye(3)
        slides = p[..., None] * (phi[..., None] * eye + bend[..., None, None] * v[..., None] * V)
        across = eye - n[..., None] * N
        force_w = -u[..., None] * (p_sink * n)[..., None, :] - slides @ across
        work = (q.ratio * q.speed)[..., None]
        grip = p * (q.ratio_slip + q.phi)[..., None]
        heat_w = -p_sink * work * n + grip * v
        force_y, heat_y = -u[..., None] * (p_depth * n)[..., None, :], -p_depth * work * n
        force_n, heat_n = np.zeros_like(force_y), np.zeros_like(heat_y)
        if vb is not None:
            turn = _turning(vb, planes.g, planes.n)[q.of][:, None]
            force_y, heat_y = force_y + force_w @ turn, heat_y + (heat_w[..., None, :] @ turn)[
                ..., 0, :]
            off = -q.sink[..., None]  # n . w
            w = v + off * n
            force_n = -u[..., None] * (p_sink * w)[..., None, :] + p[..., None] * eye + slides @ (
                off[..., None] * eye + n[..., None] * w[..., None, :])
            heat_n = -p_sink * work * w - grip * off * v
        flow, flow_y = np.zeros_like(q.p), np.zeros_like(v)
        if T is not None and face.conductance > 0:
            flow = face.conductance * drop(q, T)
            slope = (T[:, None, 3:] @ planes.g)[q.of]
            flow_y = flow_y - face.conductance * slope
        return cls(force_y, force_w, force_n, heat_y, heat_w, heat_n, flow_y, p * u,
                   q.power(), flow)


def _turning(vb: FloatArray, g: FloatArray, n: FloatArray) -> FloatArray:
    """(P, 3, 3): dw = (-L + h n^T) y."""
    L = vb.transpose(0, 2, 1) @ g
    h = L.transpose(0, 2, 1) @ n[:, :, None]
    return np.asarray(h * n[:, None] - L)


def _measure(o: Overlaps) -> FloatArray:
    """(P, 18): derivative of the measure by the corners of both facets."""
    a, n, g = o.pairs.a, o.pairs.planes.n, o.pairs.planes.g
    opposite = np.roll(a, -1, axis=1) - np.roll(a, -2, axis=1)
    N = np.cross(a[:, 1] - a[:, 0], a[:, 2] - a[:, 0])
    first = -np.cross(opposite, n[:, None])
    second = (g @ N[:, :, None]) * n[:, None]
    return np.concatenate([first.reshape(-1, 9), second.reshape(-1, 9)], axis=1)


def _first_moves(
    o: Overlaps, q: Samples, W: FloatArray, of: Answers
) -> tuple[FloatArray, FloatArray]:
    """Forces (M, 9, 9) by position and by velocity of the first facet's corners."""
    M, k = W.shape
    pairs = (q.s[..., :, None] * q.s[..., None, :]).reshape(M, k, 9) * W[..., None]
    made = [pairs.transpose(0, 2, 1) @ force.reshape(M, k, 9)
            for force in (of.force_y, of.force_w)]
    by_z, by_rate = (f.reshape(M, 3, 3, 3, 3).transpose(0, 1, 3, 2, 4).reshape(M, 9, 9)
                     for f in made)
    return by_z, by_rate


def _warm_first(
    o: Overlaps, q: Samples, W: FloatArray, of: Answers, face: Interface
) -> tuple[FloatArray, FloatArray]:
    """Heats (M, 6, 9) by position and by velocity of the first facet's corners."""
    M, k = W.shape

    def columns(by: FloatArray) -> FloatArray:
        return (q.s[..., :, None] * by[..., None, :]).reshape(M, k, 9) * W[..., None]

    by_z = _heats(q, columns(of.heat_y), face.share) + _conducted(q, columns(of.flow_y))
    moved = _carried(o, q, of, face.share) * W[..., None, None]
    by_z[:, 3:] += np.einsum("mqja,mqi->mjia", moved, q.s).reshape(M, 3, 9)
    return by_z, _heats(q, columns(of.heat_w), face.share)


def _heats(q: Samples, columns: FloatArray, share: float) -> FloatArray:
    """(M, 6, D): friction heat's derivative columns (M, q, D) at the six corners."""
    return np.concatenate([share * (q.s.transpose(0, 2, 1) @ columns),
                           (1.0 - share) * (q.eta.transpose(0, 2, 1) @ columns)], axis=1)


def _conducted(q: Samples, columns: FloatArray) -> FloatArray:
    """(M, 6, D): heat that flows leaves the first and enters the second."""
    return np.concatenate([-(q.s.transpose(0, 2, 1) @ columns),
                           q.eta.transpose(0, 2, 1) @ columns], axis=1)


def _carried(o: Overlaps, q: Samples, of: Answers, share: float) -> FloatArray:
    """(M, q, 3, 3): what d eta = g . y adds to the heat at the second facet's corners, by y."""
    into = (1.0 - share) * of.heat + of.flow
    return np.asarray(into[..., None, None] * o.pairs.planes.g[q.of][:, None])


def placing(o: Overlaps, q: Samples) -> FloatArray:
    """(M, q, 3, 18): y by the corners of both facets."""
    n, g = o.pairs.planes.n[q.of], o.pairs.planes.g[q.of]
    eye = np.eye(3)
    first = q.s[..., None, :, None] * eye[:, None]
    lean = g.transpose(0, 2, 1)[..., None] * n[:, None, None]  # (M, a, k, b)
    second = -(q.eta[..., None, :, None] * eye[:, None]
               + q.depth[..., None, None, None] * lean[:, None])
    shape = (*q.p.shape, 3, 9)
    return np.concatenate([first.reshape(shape), second.reshape(shape)], axis=3)


def _both_move(
    o: Overlaps, q: Samples, W: FloatArray, of: Answers
) -> tuple[FloatArray, FloatArray]:
    """Forces (M, 18, 18) by position and by velocity of both facets' corners."""
    B, tilt, swing = _moves(o, q)
    M, k = W.shape
    by_z = of.force_y @ B + of.force_n @ tilt - of.force_w @ swing
    back = (W[..., None, None] * B).transpose(0, 3, 1, 2).reshape(M, 18, 3 * k)
    at_corners, by_rate = (back @ x.reshape(M, 3 * k, 18) for x in (by_z, of.force_w @ B))
    return at_corners + _bent(o, q, W, of, B, tilt), by_rate


def _warm_both(
    o: Overlaps, q: Samples, W: FloatArray, of: Answers, face: Interface
) -> tuple[FloatArray, FloatArray]:
    """Heats (M, 6, 18) by position and by velocity of both facets' corners."""
    B, tilt, swing = _moves(o, q)

    def columns(by: FloatArray, of_what: FloatArray) -> FloatArray:
        return W[..., None] * (by[..., None, :] @ of_what)[..., 0, :]

    heat = columns(of.heat_y, B) + columns(of.heat_n, tilt) - columns(of.heat_w, swing)
    by_z = _heats(q, heat, face.share) + _conducted(q, columns(of.flow_y, B))
    by_z[:, 3:] += (W[..., None, None] * (_carried(o, q, of, face.share) @ B)).sum(axis=1)
    return by_z, _heats(q, columns(of.heat_w, B), face.share)


def _moves(o: Overlaps, q: Samples) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(M, q, 3, 18), (M, 1, 3, 18), (M, q, 3, 18): y, dn and d dh by both facets' corners."""
    tilt, swing = (x[q.of][:, None] for x in _tilts(o))
    return placing(o, q), tilt, q.depth[..., None, None] * swing


def _tilts(o: Overlaps) -> tuple[FloatArray, FloatArray]:
    """(P, 3, 18) each: the normal, and h, by the corners of both facets."""
    n, g, vb = o.pairs.planes.n, o.pairs.planes.g, o.pairs.vb
    assert vb is not None
    P = len(n)
    tilt, swing = np.zeros((P, 3, 18)), np.zeros((P, 3, 18))
    tilt[:, :, 9:] = -(g.transpose(0, 2, 1)[..., None] * n[:, None, None]).reshape(P, 3, 9)
    L = vb.transpose(0, 2, 1) @ g
    h = (L.transpose(0, 2, 1) @ n[:, :, None])[:, :, 0]
    swing[:, :, 9:] = -(g.transpose(0, 2, 1)[..., None] * h[:, None, None]).reshape(P, 3, 9)
    swing += (L.transpose(0, 2, 1) - n[:, :, None] * h[:, None]) @ tilt
    return tilt, swing


def _bent(
    o: Overlaps, q: Samples, W: FloatArray, of: Answers, B: FloatArray, tilt: FloatArray
) -> FloatArray:
    """(M, 18, 18): what a constant force adds because its weights at the second corners move."""
    n, g = o.pairs.planes.n[q.of], o.pairs.planes.g[q.of]
    F = W[..., None] * of.force
    M = len(W)
    gF, nF = (F @ g.transpose(0, 2, 1)), (F @ n[:, :, None])[..., 0]  # (M, q, 3), (M, q)
    gB = g[:, None] @ B  # (M, q, 3, 18): d eta
    found = np.zeros((M, 18, 18))
    second = found[:, 9:].reshape(M, 3, 3, 18)
    second -= np.einsum("mqa,mqjc->mjac", F, gB)
    nB = (n[:, None, None] @ B)[..., 0, :]
    second += np.einsum("mqj,mqc,ma->mjac", gF, nB, n)  # -dd (g . F) n with dd = -n . y
    arm = (q.depth[..., None] * gF).sum(axis=1)
    up = (q.depth * nF).sum(axis=1)
    t = tilt[:, 0]
    # dg = -sum g (g_j . db) - n (g_j . dn)
    by_b = np.zeros((M, 3, 18))
    by_b[:, :, 9:] = (arm[:, None, :, None] * g[:, :, None]).reshape(M, 3, 9)
    by_b += up[:, None, None] * (g @ t)
    second += by_b[:, :, None] * n[:, None, :, None]
    second -= arm[:, :, None, None] * t[:, None]
    found[:, 9:] = second.reshape(M, 9, 18)
    return found


def _conduction(
    o: Overlaps, q: Samples, W: FloatArray, face: Interface, sums: csr_array
) -> FloatArray:
    """(P, 6, 6)"""
    if face.conductance == 0.0:
        return np.zeros((len(o.at), 6, 6))
    g = np.concatenate([q.s, -q.eta], axis=2)
    local = -face.conductance * ((g * W[..., None]).transpose(0, 2, 1) @ g)
    return np.asarray(sums @ local.reshape(len(W), 36)).reshape(-1, 6, 6)
