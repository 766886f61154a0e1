"""Contact of two surfaces as a local term of the equations: what is the same in the plane and in
space. ContactTerm and SpatialContactTerm add where points are and how unknowns move them."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Generic, Protocol, Self, TypeVar

import numpy as np

from sparsemor.bodies.any_body import AnyBody
from sparsemor.bodies.contact.follow import FollowedContact
from sparsemor.bodies.contact.near import Near
from sparsemor.bodies.contact.pace import Mover
from sparsemor.bodies.contact.tractions import Interface
from sparsemor.bodies.local import CompressedLocal
from sparsemor.core.arrays import BoolArray, Csr, FloatArray, IntArray
from sparsemor.core.protocols import Trial


class _Surface(Protocol):
    @property
    def body(self) -> AnyBody: ...
    @property
    def facets(self) -> IntArray: ...


class OneSide(Protocol):
    """One of the two surfaces as a term sees it."""

    @property
    def surface(self) -> _Surface: ...


S = TypeVar("S", bound=OneSide)


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceTerm(ABC, Generic[S]):
    """Rows: minus the generalized forces, and minus the heat, of what acts between two surfaces.

    deforms: points move with the displacements, so that facets are looked for where they are;
    reach: deepest penetration (m) that is trusted; active: facets (F,) of each surface that are
    evaluated (against all of the other).
    """

    RESULTANTS: ClassVar[tuple[str, ...]]

    rows: IntArray
    columns: IntArray
    sides: tuple[S, S]
    face: Interface
    near: Near
    deforms: bool
    reach: float
    active: tuple[BoolArray, BoolArray]
    source: str = ""

    @property
    def elements(self) -> int:
        """Facets of the first surface that are evaluated, each against those near it."""
        first, second = (int(a.sum()) for a in self.active)
        return min(len(self.active[0]), first + second)

    @property
    def _whole(self) -> bool:
        """Whether every pair of facets is evaluated."""
        return bool(self.active[0].all() or self.active[1].all())

    def _pairs(self, middles: FloatArray, tree: object) -> tuple[IntArray, IntArray]:
        """Facets of both surfaces that are evaluated with each other."""
        f, g = self.near.pairs(middles, tree)
        if self._whole:
            return f, g
        wanted = self.active[0][f] | self.active[1][g]
        return f[wanted], g[wanted]

    # ------------------------------------------------------------------ evaluation

    @abstractmethod
    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray: ...

    @abstractmethod
    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr: ...

    def doubt(self, x: FloatArray, v: FloatArray, t: float, h: float) -> str:
        """Why the state at the end of a step of about h (s) is not to be trusted; "" if it is."""
        depth = self._too_deep(x, v, t, h)
        if depth == 0.0:
            return ""
        first, second = (s.surface.body.name for s in self.sides)
        return (f"contact {self.source}: a point of {first} went {depth:.2g} m below the "
                f"surface of {second}, more than half the smallest facet "
                f"({self.reach:.2g} m): the step is too long for this contact, or its foundation "
                "too soft")

    @abstractmethod
    def _too_deep(self, x: FloatArray, v: FloatArray, t: float, h: float) -> float:
        """How far (m) a point of the first surface went below the second, 0 where not too far."""

    @property
    def histories(self) -> tuple[str, ...]:
        """Names of the resultants that this term knows: none where it leaves facets out."""
        return self.RESULTANTS if self._whole else ()

    @abstractmethod
    def resultants(self, x: FloatArray, v: FloatArray, t: float) -> dict[str, float]:
        """The contact at one moment, by the names in `RESULTANTS`. x, v: of an accepted step."""

    # ------------------------------------------------------------------ reduction

    @abstractmethod
    def restrict(self, keep: IntArray) -> Self:
        """Only facets that touch the kept rows, and what those and their partners read."""

    def compress(self, trial: Trial, left: FloatArray) -> CompressedLocal | FollowedContact:
        local = CompressedLocal.of(self, trial, left)
        return FollowedContact.of(local) if self.deforms and local.elements else local

    # ------------------------------------------------------------------ as a Followable

    @property
    @abstractmethod
    def movers(self) -> tuple[Mover, Mover]:
        """Both surfaces, their unknowns among the columns."""

    @abstractmethod
    def points(self, x: FloatArray, t: float) -> tuple[FloatArray, FloatArray] | None:
        """(n1, d), (n2, d), m, in any axes that both share; None for a state that overflowed."""

    @abstractmethod
    def among(self, first: IntArray, second: IntArray) -> tuple[Self, IntArray, IntArray]:
        """The contact of some facets of either surface with each other alone, and which of the
        columns and of the rows are theirs."""


def every(sides: tuple[OneSide, OneSide]) -> tuple[BoolArray, BoolArray]:
    """All facets of both surfaces."""
    first, second = (np.ones(len(s.surface.facets), bool) for s in sides)
    return first, second
