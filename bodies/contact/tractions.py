"""Tractions and heat between two facets, as forces and heat at their corners.

The force on the first body is p n - tau per area, tau along the slip. It acts on both bodies at one
place: on the first facet's corners with weights s, on the second's as on a rigid arm from its
projection. With the second body's virtual displacement there, sum eta db + delta sum g (n . db)
(pieces.py), a force F is eta F + delta (g . F) n at its corners. So forces *and* torques are equal
and opposite however deep the penetration is, and their power is that of the penetration's rate and
the slip.
"""

from dataclasses import dataclass

import numpy as np

from sparsemor.bodies.contact.pieces import DEPTH, SINK, Overlaps, Pieces
from sparsemor.core import FloatArray, FrictionLaw, IntArray, NormalLaw


@dataclass(frozen=True, slots=True, eq=False)
class Interface:
    """Laws between two surfaces. width: thickness (m) in the plane, 1 in space; share: part of the
    friction heat that enters the first body; conductance W/(m2 K); points (q, d), weights (q,):
    Gauss rule in barycentric numbers (quadrature.py)."""

    normal: NormalLaw
    friction: FrictionLaw | None
    width: float
    share: float
    conductance: float
    points: FloatArray
    weights: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Contact variables at places s (N, q, d) of overlaps `of` (N,): penetration (m), its rate and
    the slip (m/s, d), eta (d); pressure (Pa) with its derivatives; speed of the slip, in the plane
    with its sign along the second facet; ratio of friction to pressure with its derivative by the
    speed; phi = ratio / speed, s/m."""

    of: IntArray
    s: FloatArray
    depth: FloatArray
    sink: FloatArray
    slip: FloatArray
    eta: FloatArray
    p: FloatArray
    p_depth: FloatArray
    p_sink: FloatArray
    speed: FloatArray
    ratio: FloatArray
    ratio_slip: FloatArray
    phi: FloatArray

    @classmethod
    def at(cls, o: Overlaps, of: IntArray, s: FloatArray, face: Interface) -> "Samples":
        at, d = s @ o.at[of], o.d
        depth, sink = np.maximum(at[:, :, DEPTH], 0.0), at[:, :, SINK]
        slip, eta = at[:, :, 2 : 2 + d], at[:, :, 2 + d :]
        p, p_depth, p_sink = face.normal.pressure(depth, sink)
        if p.min(initial=0.0) < 0.0:
            pushes = p >= 0.0
            p, p_depth, p_sink = (np.where(pushes, a, 0.0) for a in (p, p_depth, p_sink))
        if d == 2:
            speed = (s @ o.speed[of][:, :, None])[:, :, 0]
        else:
            speed = np.sqrt(np.einsum("nqi,nqi->nq", slip, slip))
        none = np.zeros_like(p)
        ratio, slope = (none, none) if face.friction is None else face.friction.ratio(speed)
        moves = speed != 0.0
        phi = np.where(moves, ratio, slope) / np.where(moves, speed, 1.0)
        return cls(of, s, depth, sink, slip, eta, p, p_depth, p_sink, speed, ratio, slope, phi)

    def drag(self) -> FloatArray:
        """(N, q, d) friction on the first body, per area of the second surface, Pa."""
        return np.asarray(-(self.p * self.phi)[:, :, None] * self.slip)

    def power(self) -> FloatArray:
        """(N, q) friction heat, W/m2."""
        return self.p * self.ratio * self.speed


@dataclass(frozen=True, slots=True, eq=False)
class Loads:
    """Of each simplex of the pieces: force (M, 2 d, d), N, and heat (M, 2 d), W, on the corners of
    both facets, d of the first and d of the second; push and drag (M, d), N, on the first body;
    power (M,), W; area (M,) in contact, m2."""

    force: FloatArray
    heat: FloatArray
    push: FloatArray
    drag: FloatArray
    power: FloatArray
    area: FloatArray


def weights_of(o: Overlaps, pieces: Pieces, face: Interface) -> FloatArray:
    """(M, q), m2: integration weight of each point on the second surface: its share of the area."""
    area = pieces.size * o.measure[pieces.overlap] * face.width
    return np.asarray(area[:, None] * face.weights)


def nodal(o: Overlaps, pieces: Pieces, face: Interface, T: FloatArray | None) -> Loads:
    """T (P, 2 d): temperatures at the corners of the overlaps' facets, K, for conduction."""
    q = Samples.at(o, pieces.overlap, pieces.samples(face.points), face)
    W = weights_of(o, pieces, face)
    n, g = o.pairs.planes.n[q.of], o.pairs.planes.g[q.of]
    push, drag = W * q.p, W[:, :, None] * q.drag()
    force = push[:, :, None] * n[:, None] + drag
    arm = (q.depth[:, None] @ drag)[:, 0]  # the pressure has none
    lift = (g @ arm[:, :, None]) * n[:, None]
    ends = [q.s.transpose(0, 2, 1) @ force, -(q.eta.transpose(0, 2, 1) @ force) - lift]
    power = W * q.power()
    g1 = face.share
    heat = [g1 * _summed(power, q.s), (1.0 - g1) * _summed(power, q.eta)]
    if T is not None and face.conductance > 0:
        flow = W * face.conductance * drop(q, T)
        heat = [heat[0] - _summed(flow, q.s), heat[1] + _summed(flow, q.eta)]
    whole = push.sum(axis=1)
    return Loads(np.concatenate(ends, axis=1), np.concatenate(heat, axis=1), whole[:, None] * n,
                 drag.sum(axis=1), power.sum(axis=1), np.where(whole > 0, W.sum(axis=1), 0.0))


def drop(q: Samples, T: FloatArray) -> FloatArray:
    """(N, q) temperature of the first surface above the second's, K."""
    at, d = T[q.of], q.s.shape[2]
    one, two = q.s @ at[:, :d, None], q.eta @ at[:, d:, None]
    return np.asarray((one - two)[:, :, 0])


def _summed(values: FloatArray, weights: FloatArray) -> FloatArray:
    """(N, d) of values (N, q) times weights (N, q, d)."""
    return np.asarray((values[:, None] @ weights)[:, 0])
