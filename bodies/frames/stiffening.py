"""Geometric stiffness as a part of a frame's equations: loads that act on the displacements through
the frame multiply matrices."""

from dataclasses import dataclass

from sparsemor.bodies.frames import plane_items as plane
from sparsemor.bodies.frames import space_items as spatial
from sparsemor.bodies.frames.items import Item
from sparsemor.bodies.frames.motion import Motion, Sums
from sparsemor.bodies.frames.motion_at_times import Moved, Pushed
from sparsemor.core.protocols import FrameWork


@dataclass(frozen=True, slots=True, eq=False)
class Stiffening(Item):
    """Force sum_j sigma_j H_j u on the displacements u, where sigma_j is the present factor of the
    load on functional j of the frame, and H_j the geometric stiffness of a unit of this load.

    matrices: number of functionals of the frame, all of which have one; first: number of inertia
    matrices M_g, which come before. It is the last item of its frame.
    """

    first: int
    matrices: int = 0
    others = 0
    pushes = True

    def in_plane(self) -> plane.PlanePart:
        return plane.PlanePart(plane.stiffening, (float(self.matrices), float(self.first)))

    def in_space(self) -> tuple[spatial.SpacePart, ...]:
        return (spatial.SpacePart(
            spatial.stiffening, (float(self.matrices), float(self.first))),)

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        self.push(m, j, out)

    def push(self, m: Moved, j: int, out: Pushed) -> None:
        out.coefficients[..., self.first : self.first + self.matrices] = out.sigma

    def bend(self, work: FrameWork) -> None:
        work.kappa_y[:, self.first : self.first + self.matrices] = work.sigma[:-1]
