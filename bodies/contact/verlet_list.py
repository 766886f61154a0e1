"""Verlet list of a reduced contact on deformed surfaces: only facets close to the other surface are
evaluated.

The list contains the facets of each surface that have a facet of the other one within the search
radius plus a margin, and the state at which it was built. While no node can have moved farther than
the margin since then, no other pair of facets can touch, and the result equals that of all facets
(Verlet 1967, doi 10.1103/PhysRev.159.98). The displacement of the nodes is bounded through the
change of the few reduced unknowns. So a step costs what the facets near the contact cost; only
building a new list costs as much as the number of all facets.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy.spatial import cKDTree

from sparsemor.core import BoolArray, FloatArray, IntArray
from sparsemor.core.model.compressed_local import CompressedLocal
from sparsemor.core.protocols.term import DelegatingTerm, LocalCopy


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """A surface in d dimensions whose nodes move with unknowns.

    X (n, d): reference positions, m; facets (F, d). frame (f,), u (n, d): positions of the rigid
    coordinates (position first) and of the displacements in a list of unknowns, -1 for prescribed
    ones. The attitude is an angle (f = d + 1) or a quaternion (f = 7); a fixed frame has no
    unknowns (all -1, or f = 0).
    """

    X: FloatArray
    facets: IntArray
    frame: IntArray
    u: IntArray

    @property
    def extent(self) -> float:
        """Largest edge of the surface's axis-aligned bounding box, m."""
        return float(np.ptp(self.X, axis=0).max())


@dataclass(frozen=True, slots=True, eq=False)
class MotionBound:
    """Upper bound of the motion of one surface's nodes with k reduced unknowns.

    shift (d, k), turn (m, k): rows of the reduced basis for the frame's position and attitude;
    upright (m,): attitude coordinates at zero unknowns; own (k,): True for unknowns that deform the
    surface; gain: bound on a nodal displacement per unit norm of these, m; arm: largest distance of
    an undeformed node from the frame origin, m.
    """

    shift: FloatArray
    turn: FloatArray
    upright: FloatArray
    own: BoolArray
    gain: float
    arm: float

    @classmethod
    def from_atoms(cls, mover: Mover, atoms: FloatArray, offset: FloatArray) -> Self:
        """Bound for a surface whose full unknowns are offset + atoms @ x: atoms (N, k) trial
        vectors, x (k,) reduced unknowns."""
        d, at = mover.X.shape[1], mover.frame
        frame, rest = _rows(atoms, at), _rows(offset[:, None], at)[:, 0]
        u, u0 = _rows(atoms, mover.u), _rows(offset[:, None], mover.u)[..., 0]
        arm = float(np.linalg.norm(mover.X + u0, axis=1).max())
        gain = float(np.sqrt((u * u).sum(axis=(1, 2))).max())
        return cls(frame[:d], frame[d:], rest[d:], np.any(u != 0.0, axis=(0, 1)), gain, arm)

    def bound(self, change: FloatArray, x: FloatArray, beyond: float = 0.0) -> float:
        """Upper bound, m, of the motion of any node from x (k,) to x + change; for rates as
        `change`, of its speed, m/s.

        beyond: additional distance from the frame origin, m, of points that move with the surface.
        """
        arm = self.arm + beyond + self.gain * float(np.linalg.norm(x[self.own]))
        return float(np.linalg.norm(self.shift @ change) + self._turned(change, x) * arm
                     + self.gain * np.linalg.norm(change[self.own]))

    def _turned(self, change: FloatArray, x: FloatArray) -> float:
        """Chord on the unit circle of the rotation by `change`.

        A quaternion q, normalised, rotates by twice the angle between q and q + dq; the chord is at
        most 2 sin(angle) <= 2 |dq| / |q|, and so are the rates.
        """
        by = float(np.linalg.norm(self.turn @ change))
        if len(self.turn) < 4 or by == 0.0:
            return by
        size = float(np.linalg.norm(self.upright + self.turn @ x))
        return 2.0 * by / size if size > 0.0 else np.inf


def _rows(matrix: FloatArray, at: IntArray) -> FloatArray:
    """(..., k) rows of a matrix (N, k) at positions (...); 0 where the position is -1."""
    if not len(matrix):
        return np.zeros((*at.shape, matrix.shape[1]))
    return np.where((at >= 0)[..., None], matrix[at], 0.0)


MARGIN = 0.1
"""Margin of the list as a fraction of the smaller surface's extent, a length that does not shrink
with the facets."""


@dataclass(frozen=True, slots=True, eq=False)
class FollowedContact(DelegatingTerm):
    """Projected contact term of all facets, which builds copies with the facets of a Verlet list
    (`near`)."""

    term: CompressedLocal
    facets: tuple[IntArray, IntArray]
    bounds: tuple[MotionBound, MotionBound]
    margin: float

    @classmethod
    def from_contact(cls, whole: CompressedLocal) -> Self:
        """Projected contact `whole`, with bounds of the motion of both surfaces."""
        term: Any = whole.term
        movers: tuple[Mover, Mover] = term.movers
        first, second = (MotionBound.from_atoms(m, whole.atoms, whole.offset) for m in movers)
        extent = min(m.extent for m in movers)
        return cls(whole, (movers[0].facets, movers[1].facets), (first, second),
                   max(MARGIN * extent, term.near.radius))

    @property
    def near_radius(self) -> float:
        contact: Any = self.term.term
        return float(contact.near.radius)

    @property
    def relocates(self) -> bool:
        return True

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return self.term.residual(x, v, a, t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        return self.term.jacobian(x, v, a, t, c1, c2)

    def resultants(self, x: FloatArray, v: FloatArray, t: float) -> Mapping[str, float]:
        return self.term.resultants(x, v, t)

    def check_step(self, x: FloatArray, v: FloatArray, t: float, h: float) -> str:
        return self.term.check_step(x, v, t, h)

    def moved(self, change: FloatArray, x: FloatArray, beyond: float = 0.0) -> float:
        """Upper bound, m, of the distance that nodes of the two surfaces together move from the
        reduced state x (k,) to x + change.

        beyond: additional distance of the points from the surface, m.
        """
        first, second = self.bounds
        return first.bound(change, x, beyond) + second.bound(change, x, beyond)

    def near(self, x: FloatArray) -> "LocalContact":
        """Contact of the facets in a new Verlet list, built at the reduced state x (k,): those of
        each surface with a centroid of the other within the search radius plus the margin. w: the
        projected term of all facets, left @ term(offset + atoms x)."""
        w = self.term
        contact: Any = w.term
        points = contact.points(w.offset + w.atoms @ x, 0.0)
        if points is None:  # not a finite state: the term of all facets says so
            return LocalContact(self, x, w)
        middles = [z[f].mean(axis=1) for z, f in zip(points, self.facets, strict=True)]
        first, second = (_beside(m, other, contact.near.radius + self.margin)
                         for m, other in (middles, middles[::-1]))
        if not (len(first) and len(second)):
            return LocalContact(self, x, some=None)
        some, columns, rows = contact.among(first, second)
        return LocalContact(self, x, CompressedLocal(
            some, w.atoms[columns], w.offset[columns], np.ascontiguousarray(w.left[:, rows])))


def _beside(middles: FloatArray, others: FloatArray, radius: float) -> IntArray:
    """Numbers of the facets, given by centroids `middles`, that have a centroid of `others` within
    the radius, m."""
    distance = cKDTree(others).query(middles, distance_upper_bound=radius)[0]
    return np.flatnonzero(np.isfinite(distance))


@dataclass(frozen=True, slots=True, eq=False)
class LocalContact(LocalCopy):
    """Projected contact term of the facets in a Verlet list, valid for states that `holds` accepts.

    of: the contact of all facets; at (k,): reduced state at which the list was built; some: the
    term of the listed facets, None if there are none.
    """

    of: FollowedContact
    at: FloatArray
    some: CompressedLocal | None

    @property
    def elements(self) -> int:
        return 0 if self.some is None else self.some.elements

    def holds(self, x: FloatArray) -> bool:
        """True while the list is valid: no node has moved farther than the margin."""
        return self.of.moved(x - self.at, self.at) <= self.of.margin

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        if self.some is None:
            return np.zeros(len(self.of.term.left))
        return self.some.residual(x, v, a, t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        if self.some is None:
            return np.zeros((len(self.of.term.left), len(x)))
        return self.some.jacobian(x, v, a, t, c1, c2)

    def resultants(self, x: FloatArray, v: FloatArray, t: float) -> Mapping[str, float]:
        if self.some is None:
            return dict.fromkeys(self.of.histories, 0.0)
        return self.some.resultants(x, v, t)

    def check_step(self, x: FloatArray, v: FloatArray, t: float, h: float) -> str:
        """Tunnelling check of the contact term; empty if passed.

        It also uses the nodes' positions one step of h (s) earlier, so the list must be valid
        there; otherwise all facets are checked. In rotating axes a node's velocity includes that of
        the axes at a distance from the surface (beyond). moved: upper bound of the distance, or for
        rates v the speed, of nodes; at: state at which the list was built; some: its term.
        """
        whole = self.of
        beyond = whole.margin + whole.near_radius
        reached = whole.moved(x - self.at, self.at) + 2.0 * h * whole.moved(v, x, beyond)
        if not reached <= whole.margin:
            return whole.check_step(x, v, t, h)
        return "" if self.some is None else self.some.check_step(x, v, t, h)
