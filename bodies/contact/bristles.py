"""Static friction of a contact: elastic bristles on the first surface.

The nodes of the first surface are divided into patches with the shape functions phi, sums of those
of their nodes. Each patch has one deflection z (d,), m, in the second body's axes: unknowns of
first order. With the pressure p, the slip velocity w, the law's coefficient mu(|w|), and the
deflection z_0 from which bristles slip (0 without pressure),

    traction on the first body: -p mu Z,   Z = sum phi z / z_0, along the second facet,
    z' = V - (|z| - z_0)+ / tau z / |z|,   V = int phi p w dA / int phi p dA:

an elastoplastic law (Dupont et al. 2002, doi 10.1109/TAC.2002.1000274) whose bound holds but for
tau |V| / z_0 (Duvaut and Lions 1976, doi 10.1007/978-3-642-66165-5), so that the rates z' follow
from any state. Patches with the mean slip V do the work of their tractions, if mu is constant in
them. Of the power p mu Z . w bristles store p mu Z . z'; p mu Z . (w - z') is heat.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sparsemor.bodies.contact.contact_unknowns import dofs
from sparsemor.bodies.contact.overlaps import Overlaps, Pieces
from sparsemor.bodies.contact.tangent import Tangent, summed, tilts
from sparsemor.bodies.contact.tractions import ContactSamples, Interface, nodal, weights_of
from sparsemor.core import FieldKind, FloatArray, FrictionLaw, IntArray

BRISTLES = FieldKind("bristles", order=1, unit="m", title="deflection of bristles",
                     scale=1e-6, smallest=1e-9, change=1e-2)
"""Deflections of the patches of a contact."""
DELAY = 1e-11
"""Time tau, s: slipping bristles deflect by tau |V| beyond z_0."""

class Slip(FrictionLaw):
    """Traction p w, whose nodal forces are integrals of the slip."""

    def ratio(self, slip: FloatArray) -> tuple[FloatArray, FloatArray]:
        return slip, np.ones_like(slip)


@dataclass(frozen=True, slots=True, eq=False)
class Sliding:
    """Bristles at one state: normal force N (k,), N, mean slip V (k, d), m/s, and rate of the
    deflection that slips through (k, d), m/s, with its derivative by z (k, d, d)."""

    N: FloatArray
    V: FloatArray
    lost: FloatArray
    lost_z: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Bristles:
    """Bristles that slip from the deflection `give`, m: patch (n1,) of each node of the first
    surface, of `count`."""

    give: float
    patch: IntArray
    count: int

    @classmethod
    def on_nodes(cls, law: FrictionLaw | None, X: FloatArray) -> Self | None:
        """Bristles on nodes X (n1, d), m; None where the law has none."""
        if law is None or law.bristles is None:
            return None
        give, most = law.bristles
        patch = patches(X, most)
        return cls(give, patch, int(patch.max()) + 1)

    def numbers(self, corners: IntArray) -> IntArray:
        """(P, d^2) numbers of the unknowns of the patches of the corners (P, d) of first facets."""
        return dofs(self.patch[corners], corners.shape[1])

    def on(self, o: Overlaps, corners: IntArray, z: FloatArray, rate: FloatArray) -> Overlaps:
        """Overlaps with deflections Z and rates z' at the corners of the first facets."""
        at = self.patch[corners]
        return replace(o, at=np.concatenate([o.at, z[at] / self.give, rate[at]], axis=2))

    # ------------------------------------------------------------------ rows of the deflections

    def sliding(
        self, o: Overlaps, pieces: Pieces, face: Interface, corners: IntArray, z: FloatArray
    ) -> Sliding:
        """Slip of the k bristles at deflections z (k, d), m, for overlaps without them, from which
        their rates z' = V - lost follow: the mean slip V = int phi p w dA / int phi p dA, and the
        rate lost = (|z| - z_0)+ / tau z / |z| by which they slip through, with its derivative by z.

        corners (P, d): nodes of the first facets; phi: sum of the shape functions of a patch's
        nodes; p: pressure; w: slip velocity of the first surface along the second; z_0: `give`, the
        deflection from which bristles slip, 0 without pressure; tau: `DELAY`; N, moved: int phi p
        dA, the normal force, N, and int phi p w dA, W, first at each corner, then by patch.
        """
        _, N, moved = _integrals(o, pieces, face)
        at = self.patch[corners].ravel()
        # sums over the corners of each patch; without pressure z_0 is 0
        whole = np.bincount(at, N.ravel(), self.count).astype(np.float64)
        V = np.array([np.bincount(at, m, self.count) for m in moved.reshape(-1, o.d).T]).T
        size, z0 = np.linalg.norm(z, axis=1), np.where(whole > 0.0, self.give, 0.0)
        slips = np.where((size > z0) | (whole <= 0.0), 1.0 / DELAY, 0.0)
        share = slips * (1.0 - z0 * _inverse(size))
        e = z * _inverse(size)[:, None]
        ee = e[:, :, None] * e[:, None]
        by_z = share[:, None, None] * (np.eye(o.d) - ee) + slips[:, None, None] * ee
        return Sliding(whole, V * _inverse(whole)[:, None], share[:, None] * z, by_z)

    def by_corners(
        self, o: Overlaps, pieces: Pieces, face: Interface, corners: IntArray, now: Sliding,
        deforms: bool,
    ) -> tuple[FloatArray, FloatArray]:
        """Derivatives (P, d^2, D) of V in the rows of the corners' patches, by positions and by
        velocities of the facets' corners; deforms: True if the traction may jump at every border of
        a cell, as in `Tangent.from_overlaps`; now: N and V of the bristles.

        V = M / N with M = int phi p w dA = N n - F, F the nodal forces of the traction p (n - w):
        dV = (dM - V dN) / N; n: normal of the second facet, which moves if it deforms (vb). phi:
        shape functions of the first facet's corners, each in the row of its patch; p: pressure; w:
        slip velocity. D: coordinates of the first facet's corners (the d^2 rows of F), and of the
        second's if that deforms; tilts(o)[0]: derivative of n by these.
        """
        P, d, at = len(corners), o.d, self.patch[corners]
        o = replace(o, at=o.at[:, :, : o.eta_columns.stop])  # without bristles
        force, N, _ = _integrals(o, pieces, face)
        sliding = _sliding(face)
        tangent = Tangent.from_overlaps(
            o, pieces, sliding, nodal(o, pieces, sliding, T=None), T=None, deforms=deforms,
            warms=False)
        n = o.pairs.planes.n
        n_by = None if o.pairs.vb is None else tilts(o)[0]
        scale = _inverse(now.N)[at][:, :, None, None]
        found = []
        for by in (tangent.z, tangent.rate):
            dF = by[:, : d * d].reshape(P, d, d, -1)
            dN = (n[:, None, None] @ dF)[:, :, 0]  # N = n . F
            rest = -dF  # of dM - V dN = (n - V) dN + N dn - dF
            if by is tangent.z and n_by is not None:
                dN = dN + force @ n_by
                rest = rest + N[:, :, None, None] * n_by[:, None]
            slip = rest + (n[:, None, :, None] - now.V[at][..., None]) * dN[:, :, None]
            found.append((scale * slip).reshape(P, d * d, -1))
        return found[0], found[1]

    # ------------------------------------------------------------------ effect of the deflections

    def effect(
        self, o: Overlaps, pieces: Pieces, face: Interface, c1: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the nodal forces (P, D, d^2) and heats (P, 2 d, d^2) of each overlap by
        the deflections z at the first facet's corners; c1 (P, d^2): dz' = c1 dz; overlaps with
        deflections (`on`). D: coordinates of the first facet's corners, and of the second's if that
        deforms. W (m, q): weights of the q quadrature points of m pieces, times mu p / z_0; s, eta:
        shape functions of both facets.

        The traction on the first body is F = -p mu Z with Z = sum s z / z_0 along the second facet
        (q.bent: Z before that projection), and so linear in the deflections. On the second facet's
        corners it acts as -(eta F + depth (g . F) n), g the gradients of eta, n the normal. Heat: p
        mu Z . (w - z'), w the slip velocity (q.free: w - z'), the fraction face.share of it to the
        first facet.
        """
        q = ContactSamples.at(o, pieces.overlap, pieces.samples(face.points), face)
        P, d = len(o.at), o.d
        W = weights_of(o, pieces, face) * q.p * q.mu / self.give
        n, g = o.pairs.planes.n[q.of], o.pairs.planes.g[q.of]
        across = np.eye(d) - n[:, :, None] * n[:, None]
        own = np.einsum("mq,mqi,mqj->mij", W, q.s, q.s)
        # piece m, point q; force at corner i along a, by the deflection at corner j along b
        rows = [-np.einsum("mij,mab->miajb", own, across)]
        if o.pairs.vb is not None:
            other = np.einsum("mq,mqi,mqj->mij", W, q.eta, q.s)
            arm = np.einsum("mq,mq,mqj->mj", W, q.depth, q.s)
            rows.append(np.einsum("mij,mab->miajb", other, across)
                        + np.einsum("mj,mib,ma->miajb", arm, g, n))
        forces = np.concatenate(rows, axis=1).reshape(len(q.of), -1, d * d)
        assert q.bent is not None
        Z = q.bent - (q.bent @ n[:, :, None]) * n[:, None]
        # of the heat at a point over W: by z the tangential part of w - z', by z' -Z
        by_z, by_rate = q.free - (q.free @ n[:, :, None]) * n[:, None], -self.give * Z
        ends = face.share * q.s, (1.0 - face.share) * q.eta
        heats = []
        for by in (by_z, by_rate):
            parts = [np.einsum("mq,mqi,mqj,mqb->mijb", W, e, q.s, by) for e in ends]
            made = np.concatenate(parts, axis=1).reshape(len(q.of), -1, d * d)
            heats.append(summed(made, q.of, P))
        return summed(forces, q.of, P), heats[0] + heats[1] * c1[:, None]


def _inverse(x: FloatArray) -> FloatArray:
    """1 / x where x > 0, else 0."""
    return np.where(x > 0.0, 1.0, 0.0) / np.where(x > 0.0, x, 1.0)


def _sliding(face: Interface) -> Interface:
    """The interface with the traction p (n - w), whose nodal forces give int p and int p w."""
    return replace(face, friction=Slip(), conductance=0.0)


def _integrals(
    o: Overlaps, pieces: Pieces, face: Interface
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of each overlap and corner i of its first facet: int s_i p (n - w) dA (P, d, d), N, its
    normal part int s_i p dA (P, d), N, and int s_i p w dA (P, d, d), W."""
    loads = nodal(o, pieces, _sliding(face), T=None)
    force = summed(loads.force[:, : o.d], pieces.overlap, len(o.at))
    n = o.pairs.planes.n
    N = (force @ n[:, :, None])[:, :, 0]
    return force, N, N[:, :, None] * n[:, None] - force


def patches(X: FloatArray, most: int) -> IntArray:
    """(n,) number of the patch of each point of X (n, d), m, of at most `most` patches: the widest
    one is halved by number of points, across its longest side, until there are enough."""
    groups = [np.arange(len(X))]
    while len(groups) < min(most, len(X)):
        widths = [np.ptp(X[g], axis=0) if len(g) > 1 else -np.ones(X.shape[1]) for g in groups]
        widest = int(np.argmax([w.max() for w in widths]))
        g = groups[widest]
        order = g[np.argsort(X[g, int(np.argmax(widths[widest]))], kind="stable")]
        groups[widest : widest + 1] = [order[: len(g) // 2], order[len(g) // 2 :]]
    found = np.zeros(len(X), np.int64)
    for number, g in enumerate(groups):
        found[g] = number
    return found
