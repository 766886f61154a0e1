"""Positions and velocities of two contact surfaces in the second body's axes, their derivatives,
and a check for tunnelling: a step that moved a surface through the other one.

With frame origins R1, R2 and rotation matrices A, B of the two bodies and y = X + u in the first
body's axes,

    a = B^T (R1 - R2 + A y),    C = B^T A,    da = B^T (dR1 - dR2) + C (dphi1 x y + du) - dphi2 x a

with small rotations dphi in body axes; in the plane phi has one component.
"""

from functools import cached_property
from math import cos, sin
from typing import TypeAlias

import numpy as np

from sparsemor.bodies.contact.contact_unknowns import ContactSide, Sizes
from sparsemor.bodies.contact.surface import BroadPhase, Planes, Surface, tree_of
from sparsemor.bodies.frames.attitude import UnitQuaternion
from sparsemor.bodies.frames.rotation import LEVI_CIVITA
from sparsemor.core import FloatArray, IntArray

QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])
"""Quarter turn in the plane: w x r = w QUARTER r."""
ONE, ZERO = np.ones((1, 1)), np.zeros((1, 1))


class PlanarAttitude:
    """Attitude of a body in the plane, with the interface of `UnitQuaternion`.

    A (2, 2): rotation matrix; w (1,): angular velocity, rad/s; by (1, 1): derivative of the
    rotation by the angle, w_by: that of w. rows: generalized force of a torque (1,), N m, the same;
    rows_by: its derivative by the angle.
    """

    __slots__ = ("A", "w")
    by, w_by = ONE, ZERO

    def __init__(self, angle: float, rate: FloatArray) -> None:
        c, s = cos(angle), sin(angle)
        self.A, self.w = np.array([[c, -s], [s, c]]), rate

    def rows(self, torque: FloatArray) -> FloatArray:
        return torque

    def rows_by(self, torque: FloatArray) -> FloatArray:
        return ZERO


Attitude: TypeAlias = UnitQuaternion | PlanarAttitude


def attitude_of(pose: FloatArray, rate: FloatArray) -> Attitude:
    """Attitude of a body with rigid coordinates `pose`, position first: (x, y, angle), or in space
    position and quaternion or angle."""
    if len(pose) == 3:
        return PlanarAttitude(float(pose[2]), rate[2:])
    return UnitQuaternion.from_pose(pose, rate)


def arms(r: FloatArray) -> FloatArray:
    """(n, d, 1 or 3) cross-product matrices of r (n, d): arms(r)[i] @ w = w x r[i]; the transpose
    gives r[i] x f."""
    if r.shape[1] == 2:
        return np.stack([-r[:, 1], r[:, 0]], axis=1)[:, :, None]
    return np.asarray(np.einsum("abc,nc->nab", LEVI_CIVITA, r))


def turning(w: FloatArray) -> FloatArray:
    """(d, d) cross-product matrix of w (1,) or (3,): turning(w) @ r = w x r."""
    return np.asarray(w[0] * QUARTER if len(w) == 1 else -LEVI_CIVITA @ w)


def crossed(w: FloatArray, r: FloatArray) -> FloatArray:
    """(..., d) cross products w x r of angular velocities (..., 1 or 3) and vectors r (..., d)."""
    if r.shape[-1] != 2:
        return np.cross(w, r)
    made = np.empty(np.broadcast_shapes(w[..., 0].shape, r.shape[:-1]) + (2,))
    np.multiply(-w[..., 0], r[..., 1], out=made[..., 0])
    np.multiply(w[..., 0], r[..., 0], out=made[..., 1])
    return made


def moment(r: FloatArray, f: FloatArray) -> FloatArray:
    """(1 or 3,) resultant moment, the sum of r x f over points (n, d)."""
    if r.shape[1] == 2:
        return np.array([r[:, 0] @ f[:, 1] - r[:, 1] @ f[:, 0]])
    return np.asarray(np.cross(r, f).sum(axis=0))


class Kinematics:
    """Positions a (n1, d), b (n2, d), m, and velocities va, vb, m/s, of the surfaces' nodes in the
    second body's axes.

    x, v: local unknowns (contact_unknowns.py) and their rates; t: time, s. one, two: attitudes; B,
    C = B^T A, y = X + u: module docstring. In rates of the first surface: k (n1, d) = w_1 x y + u',
    in its own axes; drift (d,) = B^T (R1' - R2'); rate (n1, d) = drift + C k, less w_2 x a: va.
    """

    def __init__(
        self, sides: tuple[ContactSide, ContactSide], x: FloatArray, v: FloatArray, t: float
    ) -> None:
        """x, v: local unknowns of both sides (rigid coordinates, displacements), and rates; t: s.

        With origins R1, R2, rotation matrices A, B and angular velocities w_1, w_2 in body axes, C
        = B^T A and y = X + u: a = B^T (R1 - R2) + C y, k = w_1 x y + u', rate = B^T (R1' - R2') + C
        k, and va = rate - w_2 x a; of the second surface b = X + u and vb = u'. pose, rate: rigid
        coordinates of a body, position first, and their rates.
        """
        self.sizes = n = Sizes.from_sides(*sides)
        (q1, q2, u1, u2), (p1, p2, du1, self.vb) = n.split(x), n.split(v)
        pose1, rate1 = sides[0].pose(q1, p1, t)
        pose2, rate2 = sides[1].pose(q2, p2, t)
        self.one, self.two = attitude_of(pose1, rate1), attitude_of(pose2, rate2)
        self.B, d = self.two.A, n.d
        self.C = self.B.T @ self.one.A
        self.y = sides[0].surface.X + u1
        self.k = crossed(self.one.w, self.y) + du1
        self.drift = (rate1[:d] - rate2[:d]) @ self.B
        self.a = (pose1[:d] - pose2[:d]) @ self.B + self.y @ self.C.T
        self.rate = self.drift + self.k @ self.C.T
        self.va = self.rate - crossed(self.two.w, self.a)
        self.b = sides[1].surface.X + u2

    @property
    def finite(self) -> bool:
        """True if all positions and velocities are finite."""
        return bool(np.isfinite(self.a).all() and np.isfinite(self.va).all()
                    and np.isfinite(self.b).all() and np.isfinite(self.vb).all())

    # ------------------------------------------------------------------ derivatives

    @cached_property
    def by_frames(self) -> FloatArray:
        """(n1, d, frames) derivative of the first surface's positions a = B^T (R1 - R2 + A y) by
        the rigid coordinates of both bodies, position and attitude of each: da = B^T (dR1 - dR2) +
        C (dphi1 x y) - dphi2 x a. one.by, two.by: of the rotations phi, in body axes, by the
        attitude coordinates; arms(y) @ phi = phi x y; f1, f2: numbers of rigid coordinates, 0 for
        none."""
        n = self.sizes
        made = np.zeros((n.n1, n.d, n.frames))
        if n.f1:
            made[:, :, : n.d] = self.B.T
            made[:, :, n.d : n.f1] = self.C @ arms(self.y) @ self.one.by
        if n.f2:
            made[:, :, n.f1 : n.f1 + n.d] = -self.B.T
            made[:, :, n.f1 + n.d :] = -arms(self.a) @ self.two.by
        return made

    def _rates_by_frames(self, c: FloatArray) -> FloatArray:
        """(n1, d, frames) derivative of the first surface's velocities va by the rigid coordinates;
        c (frames,): derivative of their rates by the coordinates, as in `by_rates`. k = w_1 x y +
        u', drift = B^T (R1' - R2'), rate = drift + C k; by, w_by: derivatives of the rotations, in
        body axes, and of w by the attitude coordinates; arms(y) @ phi = phi x y."""
        n, d = self.sizes, self.sizes.d
        one, two = self.one, self.two
        # va = drift + C k - w_2 x a; columns: position and attitude of the first, then the second
        made = -turning(two.w) @ self.by_frames
        if n.f1:
            made[:, :, :d] += self.B.T * c[:d]
            made[:, :, d : n.f1] += self.C @ (
                arms(self.k) @ one.by + arms(self.y) @ (one.w_by + one.by * c[d : n.f1]))
        if n.f2:
            made[:, :, n.f1 : n.f1 + d] -= self.B.T * c[n.f1 : n.f1 + d]
            made[:, :, n.f1 + d :] -= (arms(self.rate) @ two.by + arms(self.a) @ (
                two.w_by + two.by * c[n.f1 + d :]))
        return made

    def by_unknowns(self, z: FloatArray, i: IntArray) -> FloatArray:
        """(P, k, m) derivatives of k quantities by the unknowns of each of P pairs: rigid
        coordinates of both bodies, then displacements of the corners.

        z (P, k, D): derivatives by the positions, in the second body's axes, of the corners of the
        first facet, i (P, d), and then of the second facet. by_frames: of these positions by rigid
        coordinates; C: by displacements of the first surface, in its body's axes; those of the
        second are its positions. n.frames, n.u1, n.u2: numbers of rigid coordinates of both bodies
        and of displacements of each surface, 0 for none.
        """
        n, D = self.sizes, i.shape[1] ** 2
        first = z[:, :, :D]
        parts = []
        if n.frames:
            parts.append(first @ self.by_frames[i].reshape(len(i), D, n.frames))
        if n.u1:
            parts.append((first.reshape(*first.shape[:2], -1, n.d) @ self.C).reshape(first.shape))
        if n.u2:
            parts.append(z[:, :, D:])
        return np.concatenate(parts, axis=2) if parts else np.zeros((*z.shape[:2], 0))

    def by_rates(self, z: FloatArray, i: IntArray, j: IntArray, c1: FloatArray) -> FloatArray:
        """(P, k, m) derivatives of k quantities, through the velocities, by the unknowns of each of
        P pairs.

        z (P, k, D): derivatives by the velocities of the corners i (P, d) of the first and j (P, d)
        of the second facet, in the second body's axes; c1 (local,): derivative of the rate of each
        unknown by the unknown (time integration formula). spin: of the first facet's velocities by
        its displacements, at constant rates of these; C: from the first to the second body's axes;
        n.frames, n.u1, n.u2: numbers of unknowns as in `by_unknowns`, 0 for none.
        """
        n, D = self.sizes, i.shape[1] ** 2
        first = z[:, :, :D]
        _, _, c_u, c_b = n.split(c1)
        parts = []
        if n.frames:
            made = self._rates_by_frames(c1[: n.frames])
            parts.append(first @ made[i].reshape(len(i), D, n.frames))
        if n.u1:
            spin = self.C @ turning(self.one.w) - turning(self.two.w) @ self.C
            own = spin + self.C * c_u[i][:, :, None]
            at = first.reshape(*first.shape[:2], -1, n.d).transpose(0, 2, 1, 3) @ own
            parts.append(at.transpose(0, 2, 1, 3).reshape(first.shape))
        if n.u2:
            parts.append(z[:, :, D:] * c_b[j].reshape(len(j), 1, D))
        return np.concatenate(parts, axis=2) if parts else np.zeros((*z.shape[:2], 0))

    # ------------------------------------------------------------------ forces

    def rows(self, f: FloatArray) -> FloatArray:
        """(local,) generalized forces of nodal forces f (n1 + n2, d), N, given in the second body's
        axes: force and moment on both frames, which are equal and opposite, then nodal forces in
        body axes. y, a: positions of the first surface in the first and second body's axes; forces
        on the second surface do not act on its frame again: their resultant is minus the first's.
        n.f1, n.f2, n.u1, n.u2: numbers of rigid coordinates and of displacements, 0 for none."""
        n, first = self.sizes, f[: self.sizes.n1]
        # resultant in space axes, and nodal forces in the first body's axes
        whole, own = self.B @ first.sum(axis=0), first @ self.C
        parts = [np.zeros(0)]
        if n.f1:
            parts += [whole, self.one.rows(moment(self.y, own))]
        if n.f2:
            parts += [-whole, self.two.rows(-moment(self.a, first))]
        if n.u1:
            parts.append(own.ravel())
        if n.u2:
            parts.append(f[n.n1 :].ravel())
        return np.concatenate(parts)

    def rows_by(self, f: FloatArray, i: IntArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives of `rows` by the rigid coordinates for constant nodal forces f (P, d, d) at
        the corners i (P, d) of the first facets.

        Returns those of the rigid coordinates' rows (frames, frames), summed, and of the corner
        displacements' rows (P, d^2, frames). The derivative of the rigid coordinates' rows by the
        displacements is the transpose of the latter. n.f1, n.f2: numbers of rigid coordinates of
        each body, 0 for none. f: in the second body's axes, N; arms(g) @ phi = phi x g; one.by: of
        the rotation phi by the attitude coordinates, one.rows_by: of the generalized force of a
        constant torque; _total(a, b): sum over points of a^T b.
        """
        n, d = self.sizes, self.sizes.d
        one, two, at = self.one, self.two, i.ravel()
        flat = f.reshape(-1, d)
        y, a, g = self.y[at], self.a[at], flat @ self.C  # g: in the first body's axes
        # columns of the position (R) and the attitude (q) of both bodies
        frames, own = np.zeros((n.frames, n.frames)), np.zeros((len(at), d, n.frames))
        R1, q1 = slice(0, d), slice(d, n.f1)
        R2, q2 = slice(n.f1, n.f1 + d), slice(n.f1 + d, n.frames)
        if n.f1:
            own[:, :, q1] = -arms(g) @ one.by
            frames[q1, q1] = one.rows_by(moment(y, g)) + one.by.T @ _total(
                arms(y), own[:, :, q1])
        if n.f2:
            f_by = arms(flat) @ two.by  # the forces turn with the second body's axes
            own[:, :, q2] = self.C.T @ f_by
            frames[q2, q2] = two.rows_by(-moment(a, flat)) - _total(f_by, arms(a)) @ two.by
            frames[R2, q2] = -self.B @ f_by.sum(axis=0)
            frames[q2, R2] = frames[R2, q2].T
            if n.f1:
                frames[R1, q2] = -frames[R2, q2]
                frames[q1, q2] = one.by.T @ _total(arms(y), own[:, :, q2])
                frames[q2, R1], frames[q2, q1] = frames[R1, q2].T, frames[q1, q2].T
        return frames, own.reshape(len(i), d * d, n.frames)


def _total(a: FloatArray, b: FloatArray) -> FloatArray:
    """(k, l) sum over i of a[i]^T b[i], for a (n, d, k) and b (n, d, l)."""
    return np.asarray(a.reshape(-1, a.shape[2]).T @ b.reshape(-1, b.shape[2]))


def too_deep(
    first: Surface, second: Surface, now: Kinematics, h: float, reach: float, near: BroadPhase
) -> float:
    """Largest depth (m) of a node of the first surface below the second, if it exceeds `reach` (m)
    and did not one step of h (s) before; else 0.

    Before a step in which it crosses a facet, a node is no farther from the facet than the distance
    that both move in the step. now.a, va, b, vb: positions and velocities of both surfaces' nodes
    in the second body's axes; near.most: largest number of facets near any point, of which four
    times as many are searched, as the search radius includes the motion.
    """
    before, before_b = now.a - h * now.va, now.b - h * now.vb  # one step earlier, to first order
    deforms = now.sizes.u2 > 0
    speed = float(np.linalg.norm(now.va, axis=1).max())
    if deforms:
        speed += float(np.linalg.norm(now.vb, axis=1).max())
    tree = tree_of(before_b, second.facets) if deforms else second.tree
    found = tree.query(before, k=np.arange(1, min(4 * near.most, tree.n) + 1),
                       distance_upper_bound=second.radius + reach + h * speed)[1]
    node, rank = np.nonzero(found < tree.n)  # the tree returns tree.n where it finds no facet
    facet = found[node, rank]
    depth = _depth(now.a[node], now.b if deforms else None, second, facet)
    deep = np.flatnonzero(depth > reach)
    if not len(deep):
        return 0.0
    was = _depth(before[node[deep]], before_b if deforms else None, second, facet[deep])
    return float(depth[deep[(was <= reach) & (was > -np.inf)]].max(initial=0.0))


def _depth(
    z: FloatArray, points: FloatArray | None, surface: Surface, facet: IntArray
) -> FloatArray:
    """(m,) depth, m, of points z (m, d) below the facets `facet` (m,); -inf outside the facet's
    cell.

    points: current node positions of the surface, None if it does not deform. z, points: in the
    axes of the surface's body. A cell is where the border functions of a facet are nonnegative;
    eta: barycentric coordinates of the projection, by their gradients g from corner 0.
    """
    if points is None:
        planes, cells = surface.planes.some(facet), surface.cells.some(facet)
    else:
        planes = Planes.from_corners(points[surface.facets[facet]])
        cells = surface.cells_at(facet, planes)
    rel = (z - planes.corner)[:, :, None]
    depth = -(planes.n[:, None] @ rel)[:, 0, 0]
    eta = (planes.g @ rel)[:, :, 0]
    eta[:, 0] += 1.0
    borders = cells.values(eta[:, None], depth[:, None])
    inside = (borders >= 0).all(axis=(1, 2))
    return np.where(inside, depth, -np.inf)
