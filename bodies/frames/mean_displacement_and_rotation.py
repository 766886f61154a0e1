"""Mean displacement and mean rotation of a set of points, such as the nodes of a bore or an end
face, from their displacements; attachments of joints to them (notation: frame_items.py)."""

from dataclasses import dataclass, replace

import numpy as np

from sparsemor.bodies.frames import plane_items as plane
from sparsemor.bodies.frames import space_items as spatial
from sparsemor.bodies.frames.frame_items import AXES, EYE, Item, Wrench
from sparsemor.bodies.frames.motion import Motion, Sums
from sparsemor.bodies.frames.rotation import GENERATORS
from sparsemor.core import FloatArray


def mean_displacement(weights: FloatArray, d: int) -> FloatArray:
    """(d N, d) columns of the weighted sum of the displacements along each axis; weights (N,)."""
    return np.asarray(np.kron(weights[:, None], np.eye(d)))


def with_torques(forces: FloatArray) -> FloatArray:
    """(d N, 1 + r) nodal forces (N, d) as a load column, and columns of the r functionals sum u x
    f."""
    G = GENERATORS[forces.shape[1]]
    torques = np.einsum("acb,nc->nba", G, forces).reshape(-1, len(G))
    return np.concatenate([forces.reshape(-1, 1), torques], axis=1)


def mean_rotation(weights: FloatArray, X: FloatArray) -> FloatArray:
    """(d N, d) columns P of the mean rotation P^T u (rad) of weighted points X (N, d), by least
    squares; weights (N,), sum 1; u: displacements point by point.

    Minimises sum w |u - u_mean - theta x arm|^2. In the plane a zero column follows, because
    functionals come in pairs there. LinAlgError if the points lie on one line, in the plane at one
    position.
    """
    arm = X - weights @ X
    lever = np.einsum("aij,nj->nia", GENERATORS[X.shape[1]], arm)  # e_a x arm
    J = np.einsum("n,nia,nib->ab", weights, lever, lever)  # theta = J^-1 sum w lever^T u
    if not np.linalg.cond(J) <= 1e12:
        raise np.linalg.LinAlgError
    turn = (weights[:, None, None] * lever).reshape(X.size, -1) @ np.linalg.inv(J)
    return np.asarray(np.pad(turn, ((0, 0), (0, X.shape[1] - turn.shape[1]))))


@dataclass(frozen=True, slots=True, eq=False)
class MeanPoint(Item):
    """Mean position of a weighted set of points, point (d,) = sum w X with sum w = 1, m; its
    multipliers are the force on it (d, N)."""

    point: FloatArray
    others = 0

    @property
    def directions(self) -> int:
        return len(self.point)

    @property
    def forces(self) -> int:
        return len(self.point)

    @property
    def reactions(self) -> tuple[tuple[str, str], ...]:
        return tuple((f"force {a}", "N") for a in AXES[: self.forces])

    def names(self, source: str) -> tuple[str, ...]:
        return tuple(f"joint {source} {a}" for a in AXES[: self.directions])

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "MeanPoint":
        return replace(self, point=self.point + s)

    def wrench(
        self, times: FloatArray, forces: FloatArray, pose: FloatArray, other: FloatArray | None
    ) -> Wrench:
        return Wrench(forces, np.zeros((len(times), 2 * len(self.point) - 3)), None)

    def in_plane(self) -> plane.PlanePart:
        return plane.PlanePart(plane.attachment, tuple(self.point.tolist()))

    def in_space(self) -> tuple[spatial.SpacePart, ...]:
        """A constraint R + A z along each space axis."""
        numbers = [spatial.constraint_numbers(self.point, axis, kind=spatial.POINT) for axis in EYE]
        return tuple(spatial.SpacePart(spatial.constraint, n, row=i) for i, n in enumerate(numbers))

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        """Adds the position R + A z, z = point + mean displacement, as constraint rows, and the
        force f of the multipliers at it, in space axes; D = d (A z) / dq. j: first functional, the
        mean displacement; k: first multiplier in m.y; m.at: attitude coordinates q in m.y. bend(f,
        z): second derivative of f . A z by q; of_space(f): d (A^T f) / dq."""
        multipliers = slice(k, k + 3)
        f = m.y[multipliers]
        z = self.point + m.s[j : j + 3] if m.elastic else self.point
        D = m.turn.of_body(z)
        out.rows[:3] += f
        out.rows[m.at] += f.dot(D)
        out.rows[multipliers] = m.R + m.A.dot(z)
        H = out.H
        H[:3, multipliers] = H[multipliers, :3] = EYE
        H[multipliers, m.at], H[m.at, multipliers] = D, D.T
        H[m.at, m.at] += m.turn.bend(f, z)
        if m.elastic:  # sigma: factors in the elastic rows; sigma_y: d sigma / dy; tau: d rows / ds
            at = slice(j, j + 3)
            out.sigma[at] = m.A.T.dot(f)
            out.sigma_y[m.at, at] = out.tau[m.at, at] = m.turn.of_space(f).T
            out.sigma_y[multipliers, at] = out.tau[multipliers, at] = m.A


@dataclass(frozen=True, slots=True, eq=False)
class Rotation(Item):
    """Rotation of a body in the plane or, with `turns`, of its frame plus the mean rotation of a
    set of its points, rad; its multiplier is the moment, N m. Two functionals with `turns`: the
    mean rotation of displacements, and 0.

    angle: mean rotation in the shape from which displacements are measured, rad.
    """

    turns: bool
    angle: float = 0.0
    others = 0
    forces = 1
    reactions = (("moment", "N m"),)

    @property
    def directions(self) -> int:
        return 2 if self.turns else 0

    def names(self, source: str) -> tuple[str, ...]:
        return (f"joint {source} turn", "") if self.turns else ()

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "Rotation":
        return replace(self, angle=self.angle + float(s[0])) if self.turns else self

    def wrench(
        self, times: FloatArray, forces: FloatArray, pose: FloatArray, other: FloatArray | None
    ) -> Wrench:
        return Wrench(np.zeros((len(times), 2)), forces, None)

    def in_plane(self) -> plane.PlanePart:
        return plane.PlanePart(plane.rotation, (float(self.turns), self.angle))
