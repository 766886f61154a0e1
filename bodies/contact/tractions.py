"""Tractions and heat between two facets, as forces and heat at their corners.

The force on the first body is p n - tau per area, with tau along the slip (notation: overlaps.py).
It acts on both bodies at the same point: it is distributed to the first facet's corners with
weights s, and acts on the second facet through a rigid arm from the projection of the point. With
the second body's virtual displacement there, sum eta db + delta sum g (n . db), a force F gives eta
F + delta (g . F) n at the second facet's corners. So forces and torques are equal and opposite for
any penetration, and their power is that of the penetration rate and the slip.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sparsemor.bodies.contact.overlaps import DEPTH, SINK, Overlaps, Pieces, pressure
from sparsemor.core import FloatArray, FrictionLaw, IntArray, NormalLaw

AT_REST = 1e-30
"""Slip speed, m/s, at which the coefficient of rest of a law is evaluated."""


@dataclass(frozen=True, slots=True, eq=False)
class Interface:
    """Constitutive laws and quadrature rule of the contact between two surfaces.

    normal: pressure by penetration and its rate; friction: traction by pressure and slip, None for
    none; width: thickness (m) in the plane, 1 in space; share: fraction of the friction heat that
    enters the first body; conductance, W/(m2 K); points (q, d), weights (q,): Gauss rule in
    barycentric coordinates (quadrature.py).
    """

    normal: NormalLaw
    friction: FrictionLaw | None
    width: float
    share: float
    conductance: float
    points: FloatArray
    weights: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ContactSamples:
    """Contact variables at q points of each of N simplices.

    of (N,): number of the overlap; s (N, q, d): points, barycentric in the first facet; depth:
    penetration, m; sink: its rate, m/s; slip (d components), m/s; eta: barycentric coordinates in
    the second facet; p, p_depth, p_sink: pressure, Pa, and its derivatives; speed: of the slip, in
    the plane with its sign along the second facet; ratio, ratio_slip: friction over pressure and
    its derivative by the speed; phi = ratio / speed, s/m.

    Of bristles (bristles.py), for which ratio and phi are zero: bent: deflection over its limit, Z
    before it is projected, None without bristles; mu: coefficient; pull (d) = mu Z: traction over
    pressure; fall (d): derivative of ln mu by the slip, s/m; free (d): slip less the rate of the
    deflection, m/s.
    """

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
    bent: FloatArray | None
    mu: FloatArray
    pull: FloatArray
    fall: FloatArray
    free: FloatArray

    @classmethod
    def at(cls, o: Overlaps, of: IntArray, s: FloatArray, face: Interface) -> "ContactSamples":
        """Pressure, slip and friction at points s (N, q, d), barycentric in the first facet, of the
        overlaps `of` (N,). A law that gives tension is cut off at 0.

        o.at: values at the first facet's corners, in columns penetration, its rate, slip (d), eta
        (d) and, with bristles, deflection over its limit (d) and rate of the deflection (d), m/s.
        With bristles: bent, that over its limit, pull = mu bent projected on the facet, fall = d ln
        mu / d slip, free = slip less the rate.
        """
        at, d, bristles = s @ o.at[of], o.d, o.eta_columns.stop
        depth, sink = np.maximum(at[:, :, DEPTH], 0.0), at[:, :, SINK]
        slip, eta = at[:, :, o.slip_columns], at[:, :, o.eta_columns]
        p, p_depth, p_sink = face.normal.pressure(depth, sink)
        if p.min(initial=0.0) < 0.0:
            pushes = p >= 0.0
            p, p_depth, p_sink = (np.where(pushes, a, 0.0) for a in (p, p_depth, p_sink))
        none, zero = np.zeros_like(p), np.zeros_like(slip)
        if at.shape[2] > bristles and face.friction is not None:
            n = o.pairs.planes.n[of]
            bent, free = at[:, :, bristles : bristles + d], slip - at[:, :, bristles + d :]
            speed = np.maximum(np.sqrt((slip * slip).sum(axis=2)), AT_REST)
            mu, mu_speed = face.friction.ratio(speed)
            pull = mu[:, :, None] * (bent - (bent @ n[:, :, None]) * n[:, None])
            fall = (mu_speed / (mu * speed))[:, :, None] * slip
            return cls(of, s, depth, sink, slip, eta, p, p_depth, p_sink, speed=none, ratio=none,
                       ratio_slip=none, phi=none, bent=bent, mu=mu, pull=pull, fall=fall, free=free)
        if d == 2:
            speed = (s @ o.speed[of][:, :, None])[:, :, 0]
        else:
            speed = np.sqrt(np.einsum("nqi,nqi->nq", slip, slip))
        ratio, slope = (none, none) if face.friction is None else face.friction.ratio(speed)
        moves = speed != 0.0  # at rest phi is the derivative of the ratio
        phi = np.where(moves, ratio, slope) / np.where(moves, speed, 1.0)
        return cls(of, s, depth, sink, slip, eta, p, p_depth, p_sink, speed=speed, ratio=ratio,
                   ratio_slip=slope, phi=phi, bent=None, mu=none, pull=zero, fall=zero, free=slip)

    def drag(self) -> FloatArray:
        """(N, q, d) friction traction on the first body, per area of the second surface, Pa."""
        force = -(self.p * self.phi)[:, :, None] * self.slip
        return force if self.bent is None else np.asarray(force - self.p[:, :, None] * self.pull)

    def power(self) -> FloatArray:
        """(N, q) friction power per area, W/m2."""
        power = self.p * self.ratio * self.speed
        return power if self.bent is None else power + self.p * (self.pull * self.free).sum(axis=2)


@dataclass(frozen=True, slots=True, eq=False)
class ContactLoads:
    """Nodal forces and heats of M simplices (segments or triangles of overlaps of two facets), and
    their resultants, in the second body's axes.

    force (M, 2 d, d), N, and heat (M, 2 d), W: on the corners of the first and then of the second
    facet; push, drag (M, d), N: pressure and friction force on the first body; power (M,): friction
    power, W; area (M,): contact area, m2.
    """

    force: FloatArray
    heat: FloatArray
    push: FloatArray
    drag: FloatArray
    power: FloatArray
    area: FloatArray


def weights_of(o: Overlaps, pieces: Pieces, face: Interface) -> FloatArray:
    """(M, q) integration weight of each quadrature point: its share of the area projected on the
    second surface, m2."""
    area = pieces.size * o.measure[pieces.overlap] * face.width
    return np.asarray(area[:, None] * face.weights)


def nodal(o: Overlaps, pieces: Pieces, face: Interface, T: FloatArray | None) -> ContactLoads:
    """Nodal forces and heats of all pieces.

    T (P, 2 d): temperatures at the corners of the overlaps' facets, K, for conduction; None
    without. W: area of each quadrature point, m2; a traction F = p n + drag acts on the first
    body's corners with weights s, on the second's as -(eta F + delta (g . F) n), delta the
    penetration; drop: temperature of the first surface minus that of the second, K.
    """
    q = ContactSamples.at(o, pieces.overlap, pieces.samples(face.points), face)
    W = weights_of(o, pieces, face)
    n, g = o.pairs.planes.n[q.of], o.pairs.planes.g[q.of]
    push, drag = W * q.p, W[:, :, None] * q.drag()
    force = push[:, :, None] * n[:, None] + drag
    # delta (g . F) n of the rigid arm (module docstring), zero for the pressure, as g . n = 0
    arm = (q.depth[:, None] @ drag)[:, 0]
    lift = (g @ arm[:, :, None]) * n[:, None]
    ends = [q.s.transpose(0, 2, 1) @ force, -(q.eta.transpose(0, 2, 1) @ force) - lift]
    power = W * q.power()
    share = face.share
    heat = [share * _summed(power, q.s), (1.0 - share) * _summed(power, q.eta)]
    if T is not None and face.conductance > 0:
        flow = W * face.conductance * drop(q, T)
        heat = [heat[0] - _summed(flow, q.s), heat[1] + _summed(flow, q.eta)]
    whole = push.sum(axis=1)
    return ContactLoads(
        np.concatenate(ends, axis=1), np.concatenate(heat, axis=1), whole[:, None] * n,
        drag.sum(axis=1), power.sum(axis=1), np.where(whole > 0, W.sum(axis=1), 0.0))


def drop(q: ContactSamples, T: FloatArray) -> FloatArray:
    """(N, q) temperature of the first surface minus that of the second one, K; T (P, 2 d): corner
    temperatures."""
    at, d = T[q.of], q.s.shape[2]
    one, two = q.s @ at[:, :d, None], q.eta @ at[:, d:, None]
    return np.asarray((one - two)[:, :, 0])


def _summed(values: FloatArray, weights: FloatArray) -> FloatArray:
    """(N, d) sums over q of values (N, q) times weights (N, q, d)."""
    return np.asarray((values[:, None] @ weights)[:, 0])


def names_of(d: int) -> tuple[str, ...]:
    """Names of the recorded resultants in dimension d.

    "normal" and "friction": magnitudes of the resultants of pressure and of friction, N; "power":
    friction power, W; "length" (m) in the plane or "area" (m2) in contact; "pressure": its maximum,
    Pa.
    """
    return "normal", "friction", "power", "length" if d == 2 else "area", "pressure"


def resultants(
    times: int, time: IntArray, o: Overlaps, pieces: Pieces, loads: ContactLoads, face: Interface
) -> Mapping[str, FloatArray]:
    """Resultants (times,) by the names of `names_of`: magnitudes of the pressure's and friction's
    forces, N, friction power, W, length, m, or area, m2, and largest pressure at corners of parts,
    Pa; time (P,): number of the time of each overlap."""
    at = time[pieces.overlap]
    normal, friction = (
        np.linalg.norm([np.bincount(at, x, times) for x in vectors.T], axis=0)
        for vectors in (loads.push, loads.drag))
    power, size = (np.bincount(at, v, times) for v in (loads.power, loads.area / face.width))
    top = np.zeros(times)
    p = pressure(o, pieces.of, pieces.parts.corners, face.normal)
    np.maximum.at(top, time[pieces.of], np.where(pieces.parts.used, p, 0.0).max(
        axis=1, initial=0.0))
    return dict(zip(names_of(o.d), (normal, friction, power, size, top), strict=True))
