"""A contact on deformed surfaces in a reduced model: only facets near each other are looked at.

Facets of either surface that have one of the other within the search radius and a margin are kept
in a list with the state that they were found at. While no point can have moved farther than the
margin since then, no other pair can meet, and the list gives what all facets would (Verlet 1967,
doi 10.1103/PhysRev.159.98). How far points can have moved is bounded by the change of the few
reduced unknowns. So a step costs what is near the contact, and only a new list, once a margin, what
the surfaces have.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy.spatial import cKDTree

from sparsemor.bodies.contact.side import Side
from sparsemor.bodies.contact.surface import plane
from sparsemor.bodies.local import CompressedLocal
from sparsemor.core.arrays import BoolArray, FloatArray

MARGIN = 0.1
"""Of the smaller surface's extent: a length that does not shrink with the facets."""


@dataclass(frozen=True, slots=True, eq=False)
class Pace:
    """How far points of one surface move at most with reduced unknowns: frame (3, k) the frame's
    share, own (k,) the unknowns that displace points, gain: m a unit of their norm, arm: largest
    distance of an undisplaced point from the frame origin, m."""

    frame: FloatArray
    own: BoolArray
    gain: float
    arm: float

    @classmethod
    def of(cls, side: Side, atoms: FloatArray, offset: FloatArray) -> Self:
        at, k = side.columns, atoms.shape[1]
        frame = atoms[at.frame] if at.frame[0] >= 0 else np.zeros((3, k))
        moves = (at.u >= 0)[:, :, None]
        u = np.where(moves, atoms[at.u], 0.0) if len(atoms) else np.zeros((len(at.u), 2, k))
        rest = np.where(at.u >= 0, offset[at.u], 0.0) if len(offset) else np.zeros(at.u.shape)
        arm = float(np.abs(side.surface.X + rest[:, 0] + 1j * rest[:, 1]).max())
        gain = float(np.sqrt((u * u).sum(axis=(1, 2))).max())
        return cls(frame, np.any(u != 0.0, axis=(0, 1)), gain, arm)

    def bound(self, change: FloatArray, x: FloatArray) -> float:
        """m, of any point, from x (k,) to x + change; of rates, m/s."""
        X, Y, turn = self.frame @ change
        arm = self.arm + self.gain * float(np.linalg.norm(x[self.own]))
        return float(np.hypot(X, Y) + abs(turn) * arm
                     + self.gain * np.linalg.norm(change[self.own]))


@dataclass(frozen=True, slots=True, eq=False)
class FollowedContact:
    """A `ReducedTerm`: the whole contact, which makes lighter copies of itself (`near`)."""

    whole: CompressedLocal
    paces: tuple[Pace, Pace]
    margin: float

    @classmethod
    def of(cls, whole: CompressedLocal) -> Self:
        term: Any = whole.term
        paces = [Pace.of(s, whole.atoms, whole.offset) for s in term.sides]
        extent = min(float(np.ptp(plane(s.surface.X), axis=0).max()) for s in term.sides)
        return cls(whole, (paces[0], paces[1]), max(MARGIN * extent, term.near.radius))

    @property
    def term(self) -> Any:
        return self.whole.term

    @property
    def elements(self) -> int:
        return self.whole.elements

    @property
    def source(self) -> str:
        return self.whole.source

    @property
    def histories(self) -> tuple[str, ...]:
        return self.whole.histories

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return self.whole.residual(x, v, a, t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        return self.whole.jacobian(x, v, a, t, c1, c2)

    def resultants(self, x: FloatArray, v: FloatArray, t: float) -> dict[str, float]:
        return self.whole.resultants(x, v, t)

    def doubt(self, x: FloatArray, v: FloatArray, t: float, h: float) -> str:
        return self.whole.doubt(x, v, t, h)

    def moved(self, change: FloatArray, x: FloatArray) -> float:
        """m, how far points of both surfaces together move at most from x (k,) to x + change."""
        return self.paces[0].bound(change, x) + self.paces[1].bound(change, x)

    def near(self, x: FloatArray) -> "NearContact":
        """The same at all states within the margin of x (k,)."""
        w, term = self.whole, self.term
        full = w.offset + w.atoms @ x
        middles = [s.points(full, 0.0 * full, 0.0).z[s.surface.facets].mean(axis=1)
                   for s in term.sides]
        first, second = (_beside(m, other, term.near.radius + self.margin)
                         for m, other in (middles, middles[::-1]))
        if not (len(first) and len(second)):
            return NearContact(self, x, None)
        some, columns, rows = term.among(first, second)
        return NearContact(self, x, CompressedLocal(
            some, w.atoms[columns], w.offset[columns], np.ascontiguousarray(w.left[:, rows])))


def _beside(middles: Any, others: Any, radius: float) -> Any:
    """Numbers of the facets that have another surface's facet within a radius."""
    distance = cKDTree(plane(others)).query(plane(middles), distance_upper_bound=radius)[0]
    return np.flatnonzero(np.isfinite(distance))


@dataclass(frozen=True, slots=True, eq=False)
class NearContact:
    """A `ReducedTerm` for states that `holds`: facets near each other at one of them; None: none.
    """

    of: FollowedContact
    at: FloatArray
    some: CompressedLocal | None

    @property
    def elements(self) -> int:
        return 0 if self.some is None else self.some.elements

    def holds(self, x: FloatArray) -> bool:
        return self.of.moved(x - self.at, self.at) <= self.of.margin

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        if self.some is None:
            return np.zeros(len(self.of.whole.left))
        return self.some.residual(x, v, a, t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        if self.some is None:
            return np.zeros((len(self.of.whole.left), len(x)))
        return self.some.jacobian(x, v, a, t, c1, c2)

    def resultants(self, x: FloatArray, v: FloatArray, t: float) -> dict[str, float]:
        if self.some is None:
            return dict.fromkeys(self.of.histories, 0.0)
        return self.some.resultants(x, v, t)

    def doubt(self, x: FloatArray, v: FloatArray, t: float, h: float) -> str:
        """Asked where the points were a step of h (s) before, too: the list must hold there."""
        whole = self.of
        reached = whole.moved(x - self.at, self.at) + 2.0 * h * whole.moved(v, x)
        if not reached <= whole.margin:
            return whole.doubt(x, v, t, h)
        return "" if self.some is None else self.some.doubt(x, v, t, h)
