"""Where the points of both surfaces are in the second body's axes, and how unknowns move them.

The local unknowns are, in this order: the first frame's, the second's, the displacements of the
first surface's points and of the second's; those that a side does not have are left out.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_array, eye_array, hstack, kron, vstack

from sparsemor.bodies.contact.spatial.side import Side
from sparsemor.bodies.contact.spatial.turn import Turn
from sparsemor.bodies.spatial.rotation import LEVI_CIVITA, skew
from sparsemor.core.arrays import Csr, FloatArray, IntArray


def skews(v: FloatArray) -> FloatArray:
    """(n, 3, 3) of v (n, 3): skews(v)[i] @ w = v[i] x w."""
    return np.asarray(np.einsum("acb,nc->nab", LEVI_CIVITA, v))


@dataclass(frozen=True, slots=True, eq=False)
class Sizes:
    """How many local unknowns are of which kind: frames f1, f2, displacements u1, u2; and points
    n1, n2 of the surfaces."""

    f1: int
    f2: int
    u1: int
    u2: int
    n1: int
    n2: int

    @classmethod
    def of(cls, first: Side, second: Side) -> "Sizes":
        return cls(len(first.frame), len(second.frame), len(first.u), len(second.u),
                   len(first.surface.nodes), len(second.surface.nodes))

    @property
    def whole(self) -> int:
        return self.f1 + self.f2 + self.u1 + self.u2

    @property
    def frames(self) -> int:
        return self.f1 + self.f2

    def split(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """x (whole,) by kind, displacements as (n, 3), zero where there are none."""
        a, b = self.f1, self.frames
        c = b + self.u1
        u1 = x[b:c].reshape(-1, 3) if self.u1 else np.zeros((self.n1, 3))
        u2 = x[c:].reshape(-1, 3) if self.u2 else np.zeros((self.n2, 3))
        return x[:a], x[a:b], u1, u2


class Placing:
    """At local unknowns x and their rates v: a, va (n1, 3) and b, vb (n2, 3), positions and
    velocities in the second body's axes."""

    def __init__(self, sides: tuple[Side, Side], x: FloatArray, v: FloatArray, t: float) -> None:
        self.sizes = n = Sizes.of(*sides)
        (q1, q2, u1, self.u2), (p1, p2, du1, self.vb) = n.split(x), n.split(v)
        pose1, rate1 = sides[0].pose(q1, p1, t)
        pose2, rate2 = sides[1].pose(q2, p2, t)
        self.one, self.two = Turn.of(pose1, rate1), Turn.of(pose2, rate2)
        A, B = self.one.A, self.two.A
        self.B, self.C = B, B.T @ A
        self.y = sides[0].surface.X + u1
        self.k = np.cross(self.one.w, self.y) + du1
        self.drift = B.T @ (rate1[:3] - rate2[:3])
        self.a = B.T @ (pose1[:3] - pose2[:3]) + self.y @ self.C.T
        self.va = self.drift + self.k @ self.C.T - np.cross(self.two.w, self.a)
        self.b = sides[1].surface.X + self.u2

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.a).all() and np.isfinite(self.va).all()
                    and np.isfinite(self.b).all() and np.isfinite(self.vb).all())

    # ------------------------------------------------------------------ derivatives

    @cached_property
    def places(self) -> Csr:
        """(3 n1 + 3 n2, local): points by the local unknowns."""
        n, zero = self.sizes, np.zeros((self.sizes.n1, 3, 3))
        parts = []
        if n.f1:
            parts += [zero + self.B.T, -self.C @ skews(self.y) @ self.one.by]
        if n.f2:
            parts += [zero - self.B.T, skews(self.a) @ self.two.by]
        return self._matrix(parts, self.C, 1.0)

    def rates(self, c1: FloatArray) -> Csr:
        """(3 n1 + 3 n2, local): their velocities, where the rates of the unknowns change by c1
        (local,) times what these do."""
        n = self.sizes
        one, two = self.one, self.two
        c_one, c_two = c1[: n.f1], c1[n.f1 : n.frames]
        zero = np.zeros((n.n1, 3, 3))
        parts = []
        if n.f1:
            turned = -self.C @ (skews(self.k) @ one.by
                                + skews(self.y) @ (one.w_by + one.by * c_one[3:]))
            parts += [zero + self.B.T * c_one[:3], turned]
        if n.f2:
            seen = self.drift + self.k @ self.C.T
            turned = skews(seen) @ two.by + skews(self.a) @ (two.w_by + two.by * c_two[3:])
            parts += [zero - self.B.T * c_two[:3], turned]
        c_u, c_b = c1[n.frames : n.frames + n.u1], c1[n.frames + n.u1 :]
        moved = self._matrix(parts, self.C @ skew(one.w), 0.0)
        if n.u1:
            scaled = csr_array((c_u, (np.arange(n.u1), n.frames + np.arange(n.u1))),
                               shape=(n.u1, n.whole))
            turn = _everywhere(self.C, n.n1)
            moved = moved + _padded(turn @ scaled, 3 * (n.n1 + n.n2), 0)
        if n.u2:
            at = np.arange(n.u2)
            moved = moved + csr_array((c_b, (3 * n.n1 + at, n.frames + n.u1 + at)),
                                      shape=moved.shape)
        spin = _everywhere(skew(-two.w), n.n1)
        return csr_array(moved + _padded(spin @ self.places[: 3 * n.n1], moved.shape[0], 0))

    def _matrix(self, frames: list[FloatArray], turn: FloatArray, second: float) -> Csr:
        """Frames (n1, 3, k) side by side, `turn` (3, 3) at the first points' displacements,
        `second` at the others'."""
        n = self.sizes
        blocks: list[Any] = []
        if frames:
            blocks.append(csr_array(np.concatenate(frames, axis=2).reshape(3 * n.n1, -1)))
        if n.u1:
            blocks.append(_everywhere(turn, n.n1))
        top = hstack(blocks, format="csr") if blocks else csr_array((3 * n.n1, 0))
        top = _widened(top, n.whole)
        low = csr_array((3 * n.n2, n.whole))
        if n.u2 and second:
            left = csr_array((3 * n.n2, n.whole - n.u2))
            low = hstack([left, second * eye_array(n.u2)], format="csr")
        return csr_array(vstack([top, low], format="csr"))

    # ------------------------------------------------------------------ forces

    def rows(self, f: FloatArray) -> FloatArray:
        """(local,) generalized forces of f (n1 + n2, 3), N, the second body's axes: places.T f."""
        n, first = self.sizes, f[: self.sizes.n1]
        whole, own = self.B @ first.sum(axis=0), first @ self.C
        parts = []
        if n.f1:
            parts += [whole, self.one.rows(np.cross(self.y, own).sum(axis=0))]
        if n.f2:
            parts += [-whole, self.two.rows(-np.cross(self.a, first).sum(axis=0))]
        if n.u1:
            parts.append(own.ravel())
        if n.u2:
            parts.append(f[n.n1 :].ravel())
        return np.concatenate([np.zeros(0), *parts])

    def rows_by(self, f: FloatArray) -> Csr:
        """(local, local): derivative of `rows`, the forces f held."""
        n, first = self.sizes, f[: self.sizes.n1]
        whole = first.sum(axis=0)
        found: Any = np.zeros((n.frames, n.whole))
        R1, q1 = slice(0, 3), slice(3, n.f1)
        R2, q2 = slice(n.f1, n.f1 + 3), slice(n.f1 + 3, n.frames)
        u1 = slice(n.frames, n.frames + n.u1)
        g = first @ self.C  # in the first body's axes
        if n.f2:
            by_turn = -self.B @ skew(whole) @ self.two.by
            found[R2, q2] -= by_turn
            torque = -np.cross(self.a, first).sum(axis=0)
            found[q2, q2] += self.two.rows_by(torque)
            places = self.places[: 3 * n.n1]
            lever = np.swapaxes(skews(first), 0, 1).reshape(3, -1)
            found[q2] += self.two.by.T @ (places.T @ lever.T).T
        if n.f1:
            found[q1, q1] += self.one.rows_by(np.cross(self.y, g).sum(axis=0))
            found[q1, q1] += self.one.by.T @ (skews(self.y) @ skews(g)).sum(axis=0) @ self.one.by
            if n.f2:
                found[R1, q2] += by_turn
                turned = -(skews(self.y) @ (self.C.T @ skews(first))).sum(axis=0)
                found[q1, q2] += self.one.by.T @ turned @ self.two.by
            if n.u1:
                lever = np.swapaxes(skews(g), 0, 1).reshape(3, -1)
                found[q1, u1] -= self.one.by.T @ lever
        if not n.u1:
            return _padded(_widened(csr_array(found), n.whole), n.whole, 0)
        low: Any = np.zeros((n.u1, n.whole))
        if n.f1:
            low[:, q1] = (skews(g) @ self.one.by).reshape(n.u1, -1)
        if n.f2:
            low[:, q2] = -((self.C.T @ skews(first)) @ self.two.by).reshape(n.u1, -1)
        return _padded(vstack([csr_array(found), csr_array(low)], format="csr"), n.whole, 0)


def _everywhere(m: FloatArray, n: int) -> Csr:
    """(3 n, 3 n): the same (3, 3) at each point."""
    return csr_array(kron(eye_array(n), m, format="csr"))


def _widened(m: Csr, columns: int) -> Csr:
    return csr_array((m.data, m.indices, m.indptr), shape=(m.shape[0], columns))


def _padded(m: Any, rows: int, above: int) -> Csr:
    """m with empty rows above and below."""
    c = m.tocoo()
    return csr_array((c.data, (c.row + above, c.col)), shape=(rows, m.shape[1]))


def dofs(nodes: IntArray) -> IntArray:
    """(P, 3 k) numbers of the coordinates of nodes (P, k)."""
    return np.asarray((3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), -1))
