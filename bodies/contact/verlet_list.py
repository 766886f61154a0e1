"""A contact on deformed surfaces in a reduced model: only facets near each other are looked at.

Facets of either surface that have one of the other within the search radius and a margin are kept
in a list with the state that they were found at. While no point can have moved farther than the
margin since then, no other pair can meet, and the list gives what all facets would (Verlet 1967,
doi 10.1103/PhysRev.159.98). How far points can have moved is bounded by the change of the few
reduced unknowns. So a step costs what is near the contact, and only a new list, once a margin, what
the surfaces have.
"""

from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np
from scipy.spatial import cKDTree

from sparsemor.bodies.contact.broad_phase import BroadPhase
from sparsemor.bodies.contact.motion_bound import MotionBound, Mover
from sparsemor.core import CompressedLocal, FloatArray, IntArray

MARGIN = 0.1
"""Of the smaller surface's extent: a length that does not shrink with the facets."""


class Followable(Protocol):
    """A contact term of two surfaces that move with its unknowns."""

    @property
    def near(self) -> BroadPhase: ...
    @property
    def movers(self) -> tuple[Mover, Mover]: ...

    def points(self, x: FloatArray, t: float) -> tuple[FloatArray, FloatArray] | None:
        """(n1, d), (n2, d), m, in any axes that both share; None for a state that overflowed."""
        ...

    def among(self, first: IntArray, second: IntArray) -> tuple[Any, IntArray, IntArray]:
        """The contact of some facets of either surface with each other alone, and which of the
        columns and of the rows are theirs."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class FollowedContact:
    """A `ReducedTerm`: the whole contact, which makes lighter copies of itself (`near`)."""

    whole: CompressedLocal
    facets: tuple[IntArray, IntArray]
    bounds: tuple[MotionBound, MotionBound]
    margin: float

    @classmethod
    def of(cls, whole: CompressedLocal) -> Self:
        term: Any = whole.term
        movers: tuple[Mover, Mover] = term.movers
        first, second = (MotionBound.of(m, whole.atoms, whole.offset) for m in movers)
        extent = min(m.extent for m in movers)
        return cls(whole, (movers[0].facets, movers[1].facets), (first, second),
                   max(MARGIN * extent, term.near.radius))

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

    def check_step(self, x: FloatArray, v: FloatArray, t: float, h: float) -> str:
        return self.whole.check_step(x, v, t, h)

    def moved(self, change: FloatArray, x: FloatArray, beyond: float = 0.0) -> float:
        """m, how far points of both surfaces together move at most from x (k,) to x + change."""
        first, second = self.bounds
        return first.bound(change, x, beyond) + second.bound(change, x, beyond)

    def near(self, x: FloatArray) -> "LocalContact":
        """The same at all states within the margin of x (k,)."""
        w = self.whole
        term: Followable = self.term
        points = term.points(w.offset + w.atoms @ x, 0.0)
        if points is None:
            return LocalContact(self, x, w)
        middles = [z[f].mean(axis=1) for z, f in zip(points, self.facets, strict=True)]
        first, second = (_beside(m, other, term.near.radius + self.margin)
                         for m, other in (middles, middles[::-1]))
        if not (len(first) and len(second)):
            return LocalContact(self, x, None)
        some, columns, rows = term.among(first, second)
        return LocalContact(self, x, CompressedLocal(
            some, w.atoms[columns], w.offset[columns], np.ascontiguousarray(w.left[:, rows])))


def _beside(middles: FloatArray, others: FloatArray, radius: float) -> IntArray:
    """Numbers of the facets that have another surface's facet within a radius."""
    distance = cKDTree(others).query(middles, distance_upper_bound=radius)[0]
    return np.flatnonzero(np.isfinite(distance))


@dataclass(frozen=True, slots=True, eq=False)
class LocalContact:
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

    def check_step(self, x: FloatArray, v: FloatArray, t: float, h: float) -> str:
        """Asked where the points were a step of h (s) before, too: the list must hold there. In
        turning axes a point has the speed of what turns with them there, off the surface."""
        whole = self.of
        beyond = whole.margin + whole.term.near.radius
        reached = whole.moved(x - self.at, self.at) + 2.0 * h * whole.moved(v, x, beyond)
        if not reached <= whole.margin:
            return whole.check_step(x, v, t, h)
        return "" if self.some is None else self.some.check_step(x, v, t, h)
