"""Tractions and heat between two facets, as forces and heat at their four ends.

With t the direction of the second facet the force on the first body is -(tau + i p) t per area:
p pushes along the second facet's outward normal -i t, tau against the slip. It acts on both
bodies at one place, z: on the first facet's ends with weights beta = (1 - s, s), on the second's
as on a rigid arm from the projection of z, of the length of the penetration d. In the complex
plane such an arm has weights (1 - zeta, zeta), less a pull p d that would stretch the facet. So
forces *and* torques are equal and opposite however deep the penetration is, and their power is
exactly that of the penetration's rate and the slip.

Derivatives are real-linear in the four complex positions: a functional is a complex covector h
(4,) with the value sum Re(conj(h) dz), seen as 8 real numbers. Each derivative is a short sum of
products: how an output answers a scalar (depth, slip, ...) times how that scalar answers dz.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.bodies.contact.pieces import AT_A, AT_B, EDGE, Overlaps, Pieces, along
from sparsemor.bodies.planar.motion import ComplexArray
from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.protocols import FrictionLaw, NormalLaw

FIRST, SECOND = np.array([-1.0, 1.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Interface:
    """What is between the surfaces. width: thickness, m; share: part of the friction heat that
    enters the first body; conductance W/(m2 K); points, weights: Gauss rule on [0, 1]."""

    normal: NormalLaw
    friction: FrictionLaw | None
    width: float
    share: float
    conductance: float
    points: FloatArray
    weights: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """All that is known at quadrature points (N, q) of pieces or ends of pieces."""

    of: IntArray
    z: ComplexArray
    s: FloatArray
    t: ComplexArray
    zeta: ComplexArray
    depth: FloatArray
    sink: FloatArray
    slip: FloatArray
    p: FloatArray
    p_depth: FloatArray
    p_sink: FloatArray
    ratio: FloatArray
    ratio_slip: FloatArray
    measure: FloatArray

    @classmethod
    def at(cls, o: Overlaps, of: IntArray, s: FloatArray, face: Interface) -> "Samples":
        """measure (N, 1): area of the second surface per unit of s, m2."""
        z = o.pairs.z[of]
        e = z[:, 3:] - z[:, 2:3]
        t = e / np.abs(e)
        zeta = along(o.pairs.zeta(), of, s)
        depth, sink, slip = (along(v, of, s) for v in (o.depth, o.sink, o.slip))
        depth = np.maximum(depth, 0.0)
        p, p_depth, p_sink = face.normal.pressure(depth, sink)
        pushes = p >= 0.0
        p, p_depth, p_sink = (np.where(pushes, a, 0.0) for a in (p, p_depth, p_sink))
        none = np.zeros_like(p)
        ratio = (none, none) if face.friction is None else face.friction.ratio(slip)
        measure = -face.width * (t.conj() * (z[:, 1:2] - z[:, :1])).real
        return cls(of, z, s, t, np.asarray(zeta), depth, sink, slip, p, p_depth, p_sink, *ratio,
                   measure)

    @property
    def beta(self) -> ComplexArray:
        """(N, q, 4) weights of the relative motion: first minus second body."""
        return np.stack([1.0 - self.s, self.s, self.zeta - 1.0, -self.zeta], axis=-1)

    def force(self) -> ComplexArray:
        """(N, q) on the first body, per unit of s, N."""
        return np.asarray(-(self.ratio * self.p + 1j * self.p) * self.t * self.measure)

    @property
    def stretch(self) -> ComplexArray:
        """(N, 1, 4) covector of the relative change of the second facet's length."""
        z = self.z
        return np.asarray((SECOND / (z[:, 3:] - z[:, 2:3])).conj()[:, None, :])

    def pull(self) -> FloatArray:
        """(N, q) what the complex weights would stretch the second facet with, per unit of s, N m.
        """
        return np.asarray(self.p * self.depth * self.measure)

    def at_ends(self, W: FloatArray) -> ComplexArray:
        """(N, 4) forces on the ends: the sum over points with weights W (N, q)."""
        whole = (W * self.force())[:, :, None] * self.beta.conj()
        return np.asarray(whole.sum(axis=1) - (W * self.pull()).sum(axis=1)[:, None]
                          * self.stretch[:, 0])

    def power(self) -> FloatArray:
        """(N, q) friction heat per unit of s, W."""
        return np.asarray(self.ratio * self.p * self.slip * self.measure)

    def heat_weights(self, share: float) -> FloatArray:
        """(N, q, 4) of the friction heat; their sum is one."""
        eta, g = self.zeta.real, share
        return np.stack([g * (1 - self.s), g * self.s, (1 - g) * (1 - eta), (1 - g) * eta], -1)

    def drop_weights(self) -> FloatArray:
        """(N, q, 4): first minus second surface's value at the point."""
        eta = self.zeta.real
        return np.stack([1 - self.s, self.s, eta - 1.0, -eta], axis=-1)


def nodal(
    o: Overlaps, pieces: Pieces, face: Interface, T: FloatArray | None
) -> tuple[ComplexArray, FloatArray, Samples]:
    """Forces (N, 4) in N and heat (N, 4) in W on the facets' ends from each piece, and the samples.

    T (P, 4): temperatures at the ends of the overlaps' facets, K, for conduction.
    """
    length = (pieces.stop - pieces.start)[:, None]
    q = Samples.at(o, pieces.of, pieces.start[:, None] + length * face.points, face)
    W = length * face.weights
    heat = ((W * q.power())[:, :, None] * q.heat_weights(face.share)).sum(axis=1)
    if T is not None and face.conductance > 0:
        g = q.drop_weights()
        flow = face.conductance * (g @ T[pieces.of][:, :, None])[:, :, 0] * q.measure * W
        heat -= (flow[:, :, None] * g).sum(axis=1)
    return q.at_ends(W), np.asarray(heat), q


@dataclass(frozen=True, slots=True, eq=False)
class Slopes:
    """Derivatives of the 8 force components and 4 heats of each piece: by position (N, 12, 8), by
    velocity (N, 12, 8), by temperature (N, 12, 4)."""

    z: FloatArray
    rate: FloatArray
    T: FloatArray

    @classmethod
    def of(
        cls, o: Overlaps, pieces: Pieces, q: Samples, face: Interface, T: FloatArray | None,
        bent: BoolArray,
    ) -> "Slopes":
        """bent (P, 2): ends of the second facets where the traction may jump."""
        length = (pieces.stop - pieces.start)[:, None]
        answers, scalars = _Answers(o, q, face, T), _Scalars(o, q)
        W = (length * face.weights)[:, :, None]
        by_z = [(getattr(answers, name), getattr(scalars, name)) for name in (
            "pressure", "slip", "turn", "measure", "zeta", "zeta_i", "depth", "stretch")]
        z = _products([(W * u, h) for u, h in by_z])
        rate = _products([(W * answers.pressure, scalars.pressure_rate),
                          (W * answers.slip, scalars.slip_rate)])
        by_T = _products([(W * answers.drop, -q.drop_weights())])
        for ends, jump in _jumps(o, face, T, bent):
            np.add.at(z, _first_piece(pieces, ends.of), jump)
        return cls(z, rate, by_T)


def _products(pairs: list[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Sum over points of u (N, q, a) times h (N, q, b), over all pairs: (N, a, b)."""
    u = np.concatenate([u for u, _ in pairs], axis=1)
    h = np.concatenate([h for _, h in pairs], axis=1)
    return np.asarray(u.transpose(0, 2, 1) @ h)


def _first_piece(pieces: Pieces, overlaps: IntArray) -> IntArray:
    """A piece of each of these overlaps: all pieces of one have the same unknowns."""
    order = np.argsort(pieces.of, kind="stable")
    return np.asarray(order[np.searchsorted(pieces.of[order], overlaps)])


def as_real(h: Any) -> FloatArray:
    """Complex (..., 4) as real (..., 8)."""
    return np.ascontiguousarray(h, dtype=np.complex128).view(np.float64)


class _Scalars:
    """Covectors (N, q, 8) of penetration, pressure, slip, measure, zeta, and of the turn and the
    relative stretch of the second facet; those named `_rate` by velocity."""

    def __init__(self, o: Overlaps, q: Samples) -> None:
        z, rate = q.z, o.pairs.rate[q.of]
        e = (z[:, 3] - z[:, 2])[:, None]
        growth = ((rate[:, 3] - rate[:, 2])[:, None] / e)[:, :, None]  # stretch rate + i spin
        t, beta, d = q.t[:, :, None], q.beta, q.depth[:, :, None]
        stretch = q.stretch + 0 * beta
        turn, depth = 1j * stretch, 1j * t * beta.conj() + d * stretch
        drift = (-growth * t.conj() * beta).conj()
        self.depth, self.turn, self.stretch = as_real(depth), as_real(turn), as_real(stretch)
        self.slip = as_real(drift + (q.sink[:, :, None] - d * growth.real) * turn)
        sink = as_real(1j * drift - q.slip[:, :, None] * turn + growth.real * depth
                     + d * (growth.imag * turn - growth.real * stretch))
        self.pressure = q.p_depth[:, :, None] * self.depth + q.p_sink[:, :, None] * sink
        self.slip_rate = as_real(t * beta.conj())
        self.pressure_rate = q.p_sink[:, :, None] * self.depth
        across = (q.t.conj() * (z[:, 1] - z[:, 0])[:, None]).imag[:, :, None]
        # the width is in the samples' measure; see _Answers.measure
        self.measure = as_real(-t * FIRST - across * turn)
        c = (beta / e[:, :, None]).conj()
        self.zeta, self.zeta_i = as_real(c), as_real(1j * c)


class _Answers:
    """How forces and heats per unit of s (N, q, 12) answer each scalar of `_Scalars`."""

    def __init__(self, o: Overlaps, q: Samples, face: Interface, T: FloatArray | None) -> None:
        m, t, F = q.measure[:, :, None], q.t[:, :, None], q.force()[:, :, None]
        weights, drop, beta = q.heat_weights(face.share), q.drop_weights(), q.beta.conj()
        p, r, r1, v = (a[:, :, None] for a in (q.p, q.ratio, q.ratio_slip, q.slip))
        none = np.zeros_like(weights)
        at_second = -SECOND * (1.0 + 0.0 * F)
        Tq = np.zeros_like(weights) if T is None else T[q.of][:, None, :] + none
        h = face.conductance if T is not None else 0.0
        flow = h * (drop * Tq).sum(axis=-1, keepdims=True)  # out of the first body, W/m2
        slope = h * (Tq[:, :, 3:] - Tq[:, :, 2:3])
        d, pull = q.depth[:, :, None], q.pull()[:, :, None]
        stretch = q.stretch + 0 * beta
        self.pressure = _join(-(r + 1j) * t * m * beta - d * m * stretch, weights * r * v * m)
        self.depth = _join(-p * m * stretch, none)
        self.stretch = _join(pull * stretch, none)
        self.slip = _join(-t * p * r1 * m * beta, weights * (p * r1 * v + r * p) * m)
        self.turn = _join(1j * F * beta - 1j * pull * stretch, none)
        per_area = weights * r * p * v - flow * drop
        self.measure = face.width * _join((F * beta - pull * stretch) / m, per_area)
        on_zeta = (r * p * v * (1.0 - face.share) + flow) * SECOND + slope * drop
        self.zeta = _join(F * at_second, m * on_zeta)
        self.zeta_i = _join(-1j * F * at_second, none)
        self.drop = _join(0j * F * beta, h * m * drop)
        self.whole = _join(F * beta - pull * stretch, m * per_area)


def _join(force: Any, heat: Any) -> FloatArray:
    return np.concatenate([as_real(force), heat], axis=-1)


def _jumps(
    o: Overlaps, face: Interface, T: FloatArray | None, bent: BoolArray
) -> list[tuple[Samples, FloatArray]]:
    """What moving ends of overlaps add to the derivative by position, where tractions do not
    vanish there: integrand times the velocity of the end (Leibniz)."""
    conducts = T is not None and face.conductance > 0
    found = []
    for end, cut, sign in ((o.low, o.cut_low, -1.0), (o.high, o.cut_high, 1.0)):
        wanted = (cut == AT_A) & bent[:, 0] | (cut == AT_B) & bent[:, 1] | (cut == EDGE) & conducts
        of = np.flatnonzero(wanted)
        if not len(of):
            continue
        q = Samples.at(o, of, end[of][:, None], face)
        scalars, kind = _Scalars(o, q), cut[of][:, None]
        turn, size = o.pairs.turns[of], np.abs(o.pairs.z[of, 3] - o.pairs.z[of, 2])
        zeta = np.diff(o.pairs.zeta()[of], axis=1)
        slopes = np.stack([zeta.real - turn[:, :1] * zeta.imag,
                           -zeta.real - turn[:, 1:] * zeta.imag, size[:, None] * zeta.imag])
        s_zeta, s_i = scalars.zeta[:, 0], scalars.zeta_i[:, 0]
        moves = np.stack([s_zeta - turn[:, :1] * s_i, -s_zeta - turn[:, 1:] * s_i,
                          scalars.depth[:, 0]])
        pick = np.arange(len(of))
        velocity = -moves[kind[:, 0], pick] / slopes[kind[:, 0], pick]
        whole = _Answers(o, q, face, T).whole[:, 0]
        found.append((q, sign * whole[:, :, None] * velocity[:, None, :]))
    return found
