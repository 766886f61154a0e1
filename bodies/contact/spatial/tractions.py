"""Tractions and heat between two triangles, as forces and heat at their six corners.

The force on the first body is p n - tau per area, tau along the slip. It acts on both bodies at one
place z: on the first triangle's corners with weights s, on the second's as on a rigid arm from the
projection of z. With the second body's virtual displacement there, sum eta db + d sum g (n . db)
(pieces.py), a force F is eta F + d (g . F) n at its corners. So forces *and* torques are equal and
opposite however deep the penetration is, and their power is that of the penetration's rate and the
slip.
"""

from dataclasses import dataclass

import numpy as np

from sparsemor.bodies.contact.spatial.pieces import DEPTH, ETA, SINK, SLIP, Overlaps, Pieces
from sparsemor.bodies.contact.tractions import Interface
from sparsemor.core.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """What is known at places s (N, q, 3) of overlaps `of` (N,): penetration (m), its rate and the
    slip (m/s, 3), eta (3); pressure (Pa) with derivatives; phi: friction traction over pressure
    and slip speed, s/m, with phi_slip its derivative by the speed over the speed; ratio and speed,
    whose product with the pressure is the friction heat."""

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
        at = o.values(of, s)
        depth, sink, slip = np.maximum(at[:, :, DEPTH], 0.0), at[:, :, SINK], at[:, :, SLIP]
        p, p_depth, p_sink = face.normal.pressure(depth, sink)
        if p.min(initial=0.0) < 0.0:
            pushes = p >= 0.0
            p, p_depth, p_sink = (np.where(pushes, a, 0.0) for a in (p, p_depth, p_sink))
        speed = np.sqrt(np.einsum("nqi,nqi->nq", slip, slip))
        none = np.zeros_like(p)
        ratio, slope = (none, none) if face.friction is None else face.friction.ratio(speed)
        moves = speed > 0.0
        phi = np.where(moves, ratio, slope) / np.where(moves, speed, 1.0)
        return cls(of, s, depth, sink, slip, at[:, :, ETA], p, p_depth, p_sink, speed, ratio,
                   slope, phi)

    def drag(self) -> FloatArray:
        """(N, q, 3) friction on the first body, per area of the second surface, Pa."""
        return np.asarray(-(self.p * self.phi)[:, :, None] * self.slip)

    def power(self) -> FloatArray:
        """(N, q) friction heat, W/m2."""
        return self.p * self.ratio * self.speed


@dataclass(frozen=True, slots=True, eq=False)
class Loads:
    """Of each triangle of the pieces: force (M, 6, 3), N, and heat (M, 6), W, on the corners of
    both facets, three of the first and three of the second; push and drag (M, 3), N, on the first
    body; power (M,), W; area (M,) in contact, m2."""

    force: FloatArray
    heat: FloatArray
    push: FloatArray
    drag: FloatArray
    power: FloatArray
    area: FloatArray


def weights_of(o: Overlaps, pieces: Pieces, face: Interface) -> FloatArray:
    """(M, q), m2: area of the second surface that each point stands for."""
    return np.asarray((pieces.size * o.measure[pieces.overlap])[:, None] * face.weights)


def nodal(o: Overlaps, pieces: Pieces, face: Interface, T: FloatArray | None) -> Loads:
    """T (P, 6): temperatures at the corners of the overlaps' facets, K, for conduction."""
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
    at = T[q.of]
    one, two = q.s @ at[:, :3, None], q.eta @ at[:, 3:, None]
    return np.asarray((one - two)[:, :, 0])


def _summed(values: FloatArray, weights: FloatArray) -> FloatArray:
    """(N, 3) of values (N, q) times weights (N, q, 3)."""
    return np.asarray((values[:, None] @ weights)[:, 0])
