"""One of the two surfaces of a contact in space as the term sees it: which unknowns it reads."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sparsemor.bodies.contact.numbers import Held, elastic_numbers, thermal_numbers
from sparsemor.bodies.contact.spatial.surface import Surface
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.layout import Layout
from sparsemor.core.stage import FrameHistory


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """frame (7 or 4, or 0), u (3 n or 0), T (n): global numbers of the unknowns of a surface of n
    points, -1 where one is held. motion: of the frame, when it is told."""

    surface: Surface
    frame: IntArray
    u: IntArray
    T: IntArray
    motion: FrameHistory | None
    held: Held

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
            u = elastic_numbers(body, layout, nodes).ravel()
        T = thermal_numbers(body, layout, nodes) if conducts else np.full(len(nodes), -1)
        held = Held.of(body, nodes) if conducts else Held()
        return cls(surface, frame, u, T, motion, held)

    def some(self, chosen: IntArray) -> tuple[Self, IntArray]:
        """The same with some of the facets, and which points are theirs."""
        surface, used = self.surface.some(chosen)
        u = self.u.reshape(-1, 3)[used].ravel() if len(self.u) else self.u
        return replace(self, surface=surface, u=u, T=self.T[used], held=self.held.some(used)), used

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
