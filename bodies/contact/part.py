"""A built contact: its term inside the step, and its loads and histories along a known motion."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np
from scipy.spatial import cKDTree

from sparsemor.bodies.contact.facets import Facets
from sparsemor.bodies.contact.near import Near
from sparsemor.bodies.contact.projection import nearest
from sparsemor.bodies.contact.restless import unsettled
from sparsemor.bodies.contact.surface_term import SurfaceTerm
from sparsemor.bodies.contact.tractions import Interface
from sparsemor.core.arrays import FloatArray
from sparsemor.core.layout import Block, Layout
from sparsemor.core.protocols import Part, Term
from sparsemor.core.stage import FrameHistory, SurfaceLoads

S = TypeVar("S", bound=Facets[Any])
Motion: TypeAlias = Mapping[str, FrameHistory]
"""Body -> its motion; a body that is not named stands still."""
FLAT = 1e-3
"""Share of a surface's extent below which it has none in a direction."""
PASSAGE = 5.0
"""Least number of steps that a point should lie under the shorter surface."""


@dataclass(frozen=True, slots=True, eq=False)
class ContactPart(ABC, Generic[S]):
    """What is the same in the plane and in space; PlanarContact and SpatialContact add the rest.

    reach: deepest penetration (m) that is followed; deforms: surfaces move with the displacements;
    heats: friction heat and conduction enter the bodies that have temperatures.
    """

    name: str
    first: S
    second: S
    face: Interface
    near: Near
    reach: float
    deforms: bool
    heats: bool
    localized: bool = True
    moving: bool = True

    def blocks(self) -> Sequence[Block]:
        return ()

    # ------------------------------------------------------------------ inside the step

    def terms(self, layout: Layout, parts: Mapping[str, Part]) -> Sequence[Term]:
        """The contact inside the step, at the unknowns of the layout."""
        return _felt(self._term(layout, {}, self.face, moves=True, deforms=self.deforms,
                                conducts=self.heats))

    def conduction(self, layout: Layout, motion: Motion) -> Sequence[Term]:
        """Conduction between surfaces whose frames move as told; friction heat is not in it."""
        if self.face.conductance == 0:
            return []
        return _felt(self._term(layout, motion, replace(self.face, friction=None), moves=False,
                                deforms=False, conducts=True))

    @abstractmethod
    def _term(
        self, layout: Layout, motion: Motion, face: Interface, *, moves: bool, deforms: bool,
        conducts: bool,
    ) -> SurfaceTerm[Any]:
        """moves: frames take part with their unknowns, else as the motion tells; deforms,
        conducts: displacements and temperatures do."""

    # ------------------------------------------------------------------ along a known motion

    @abstractmethod
    def imported(self, motion: Motion) -> Mapping[str, SurfaceLoads]:
        """Body -> nodal forces in its own axes (N) and nodal friction heat (W) at each time."""

    @abstractmethod
    def history(self, motion: Motion) -> Mapping[str, FloatArray]:
        """Resultants at the times (T,) of the motion."""

    # ------------------------------------------------------------------ what a user should know

    def missed(self, motion: Motion) -> str:
        """What a user should know when the surfaces never met; "" when they did."""
        gap = 0.0 if self._pressed(motion) else self._closest(motion)
        if gap <= (self.reach if self.deforms else 0.0):
            return ""
        one, other = self.first.body.name, self.second.body.name
        return (f"contact {self.name}: the surfaces of {one} and {other} never met; the nearest "
                f"they came is {gap:.3g} m: check the poses, and that the sets name the sides that "
                "face each other")

    def unsettled(self, history: Mapping[str, FloatArray]) -> str:
        """What a user should know of the contact's history at the steps of a run; "" if nothing."""
        return unsettled(self.name, history["normal"])

    def passage(self, motion: Motion) -> str:
        """A warning where a point lies under the shorter surface for few steps; "" otherwise.

        Steps of a passage: extent of that surface along the relative motion of one step, divided
        by that motion; the smallest of 50 of the times.
        """
        count, at = steps(motion), self._points(motion)
        fewest = np.inf
        for k in np.unique(np.linspace(0, count - 2, 50).astype(int)) if count > 1 else ():
            before, after = at(slice(k, k + 1)), at(slice(k + 1, k + 2))
            fewest = min(fewest, _passage(before, after))
        if fewest >= PASSAGE:
            return ""
        return (f"contact {self.name}: a point lies under the shorter surface for {fewest:.2g} "
                f"steps only, too few for its pressure and heat (at least {PASSAGE:g}): take a "
                f"time.step {np.ceil(PASSAGE / fewest):g} times as small")

    @abstractmethod
    def _pressed(self, motion: Motion) -> bool:
        """Whether there is pressure at any of the times."""

    @abstractmethod
    def _points(self, motion: Motion) -> Callable[[slice], tuple[FloatArray, FloatArray]]:
        """Of one of the times: points (n1, d) and (n2, d), m, in any axes that both share."""

    def _closest(self, motion: Motion) -> float:
        """Smallest distance of a point of either surface from the other, at 100 of the times."""
        found, at = np.inf, self._points(motion)
        for k in np.unique(np.linspace(0, steps(motion) - 1, 100).astype(int)):
            a, b = at(slice(k, k + 1))
            for z, corners in ((a, b[self.second.facets]), (b, a[self.first.facets])):
                found = min(found, float(nearest(z, corners).distance.min()))
        return found


def _passage(
    before: tuple[FloatArray, FloatArray], after: tuple[FloatArray, FloatArray]
) -> float:
    """Extent of the shorter of two surfaces along their relative motion in its own plane, over that
    motion; infinite where they only move towards each other."""
    short, other = sorted((0, 1), key=lambda i: float(np.ptp(before[i], axis=0).max()))
    near = cKDTree(before[other]).query(before[short])[1]
    moved = np.median((after[short] - before[short]) - (after[other] - before[other])[near], axis=0)
    sizes, axes = np.linalg.svd(before[short] - before[short].mean(axis=0), full_matrices=False)[1:]
    flat = axes[sizes > FLAT * sizes[0]]
    along = flat.T @ (flat @ moved)
    length = float(np.linalg.norm(along))
    extent = float(np.ptp(before[short] @ along)) / length if length > 0.0 else 0.0
    return extent / length if extent > 0.0 else float(np.inf)


def _felt(term: SurfaceTerm[Any]) -> Sequence[Term]:
    """No term where no unknown feels it."""
    return [term] if len(term.rows) else []


def steps(motion: Motion) -> int:
    """Number of times of a motion."""
    return max((len(h.times) for h in motion.values()), default=1)
