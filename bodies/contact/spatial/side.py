"""One of the two surfaces of a contact in space as the term sees it: which unknowns it reads."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sparsemor.bodies.contact.spatial.surface import Surface
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.layout import Layout
from sparsemor.core.separable import Amplitude
from sparsemor.core.stage import FrameHistory


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """frame (7 or 4, or 0), u (3 n or 0), T (n): global numbers of the unknowns of a surface of n
    points, -1 where one is held. motion: of the frame, when it is told; given: (points, T(t)) of
    temperatures that are no unknowns."""

    surface: Surface
    frame: IntArray
    u: IntArray
    T: IntArray
    motion: FrameHistory | None
    given: Sequence[tuple[IntArray, Amplitude]]

    @classmethod
    def of(
        cls, surface: Surface, layout: Layout, *, moves: bool, deforms: bool, conducts: bool,
        motion: FrameHistory | None = None,
    ) -> Self:
        """moves: the frame's unknowns take part; deforms, conducts: those of the fields do."""
        body, nodes = surface.body, surface.nodes
        none = np.zeros(0, np.int64)
        frame = body.position(layout, "rigid") if moves else none
        u = none
        if deforms and body.elasticity is not None:
            whole = np.full(body.X.size, -1)
            whole[body.elasticity.free] = body.position(layout, "elastic")
            u = whole.reshape(-1, 3)[nodes].ravel()
        T = np.full(len(nodes), -1)
        held: tuple[tuple[IntArray, Amplitude], ...] = ()
        if conducts and body.heat is not None:
            at = np.full(len(body.X), -1)
            at[body.heat.free] = body.position(layout, "thermal")
            T = at[nodes]
            held = tuple((np.flatnonzero(np.isin(nodes, n)), f.value)
                         for n, f in body.heat.prescribed)
        return cls(surface, frame, u, T, motion, held)

    def some(self, chosen: IntArray) -> tuple[Self, IntArray]:
        """The same with some of the facets, and which points are theirs."""
        surface, used = self.surface.some(chosen)
        u = self.u.reshape(-1, 3)[used].ravel() if len(self.u) else self.u
        given = [(np.flatnonzero(np.isin(used, at)), f) for at, f in self.given]
        return replace(self, surface=surface, u=u, T=self.T[used], given=given), used

    def pose(
        self, frame: FloatArray, rate: FloatArray, t: float
    ) -> tuple[FloatArray, FloatArray]:
        """Rigid coordinates and their rates; frame, rate: the unknown ones, if there are any."""
        if self.motion is not None:
            pose, told, _ = self.motion.at(t)
            return pose, told
        if len(self.frame):
            return frame, rate
        pose = self.surface.body.pose
        return pose, np.zeros_like(pose)

    def temperature(self, T: FloatArray, t: float) -> FloatArray:
        """(n,) K, of the unknowns T (n,) where they are any, else as given."""
        T = T.copy()
        for at, function in self.given:
            T[at] = function(t)
        return T
