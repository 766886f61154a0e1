"""Unknowns of the two surfaces of a contact, and their local numbering.

Local order: rigid coordinates of the first body, of the second body, displacements of the first
surface's nodes, of the second surface's nodes; kinds that a surface lacks are left out.
Temperatures of the first and of the second surface's nodes follow.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sparsemor.bodies.contact.surface import Surface
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.core import Amplitude, BoolArray, FloatArray, FrameHistory, IntArray, Layout


def elastic_numbers(body: FloatingBody, layout: Layout, nodes: IntArray) -> IntArray:
    """(n, d) global numbers of the displacements of `nodes` (n,); -1 for fixed ones."""
    d = body.d
    numbers = np.full(d * len(body.X), -1)
    if body.elasticity is not None:
        numbers[body.elasticity.free] = body.position(layout, "elastic")
    return numbers.reshape(-1, d)[nodes]


def thermal_numbers(body: FloatingBody, layout: Layout, nodes: IntArray) -> IntArray:
    """(n,) global numbers of the temperatures of `nodes` (n,); -1 for prescribed ones."""
    numbers = np.full(len(body.X), -1)
    if body.heat is not None:
        numbers[body.heat.free] = body.position(layout, "thermal")
    return numbers[nodes]


def found_in(numbers: IntArray, among: IntArray) -> IntArray:
    """Positions of `numbers` in the sorted list `among`; -1 for numbers that are -1 or not in the
    list."""
    if not len(among):
        return np.full(numbers.shape, -1)
    at = np.minimum(np.searchsorted(among, numbers), len(among) - 1)
    return np.where((numbers >= 0) & (among[at] == numbers), at, -1)


def renumbered(positions: IntArray, kept: IntArray, size: int) -> IntArray:
    """Positions in a list of length `size`, converted to positions in the sublist `kept`; -1 for
    entries that the sublist omits."""
    new = np.full(size + 1, -1)  # the last one for positions that are -1
    new[kept] = np.arange(len(kept))
    new[-1] = -1
    return np.asarray(new[positions])


def picked(x: FloatArray, at: IntArray) -> FloatArray:
    """Entries of x (N,) at positions `at`; 0 where the position is -1."""
    return np.where(at >= 0, x[at], 0.0) if len(x) else np.zeros(at.shape)


@dataclass(frozen=True, slots=True, eq=False)
class PrescribedTemperatures:
    """Prescribed temperatures of a surface, sums of shape * f(t), K: positions of nodes among its
    nodes, f, shape (values at these nodes). _among: those of them at some nodes, with their
    positions among these."""

    prescribed: Sequence[tuple[IntArray, Amplitude, FloatArray]] = ()

    @classmethod
    def from_body(cls, body: FloatingBody, nodes: IntArray) -> Self:
        """Temperatures that the body prescribes at its `nodes` (n,), sorted."""
        if body.heat is None:
            return cls()
        return cls([_among(nodes, at, f.value, w) for at, f, w in body.heat.prescribed])

    def some(self, used: IntArray) -> "PrescribedTemperatures":
        """Prescribed temperatures at the subset `used` (m,) of the nodes, renumbered."""
        return replace(self, prescribed=[_among(used, at, f, w) for at, f, w in self.prescribed])

    def filled(self, T: FloatArray, t: float) -> FloatArray:
        """Copy of the temperatures T (n,), K, with the prescribed ones set to their values at time
        t, s."""
        T = T.copy()
        for at, _, _ in self.prescribed:
            T[at] = 0.0
        for at, function, shape in self.prescribed:
            T[at] += shape * function(t)
        return T


def _among(
    nodes: IntArray, at: IntArray, f: Amplitude, shape: FloatArray
) -> tuple[IntArray, Amplitude, FloatArray]:
    """Prescribed temperatures at nodes `at` as ones at positions in `nodes`, sorted."""
    here = np.isin(nodes, at)
    whole = np.zeros(max(nodes.max(initial=-1), at.max(initial=-1)) + 1)
    whole[at] = shape
    return np.flatnonzero(here), f, whole[nodes[here]]


@dataclass(frozen=True, slots=True, eq=False)
class ContactSide:
    """One surface of a contact with the global numbers of its unknowns.

    frame (3 in the plane, 7 or 4 in space, or 0), u (d n or 0) and T (n): global numbers of the
    rigid coordinates, nodal displacements and nodal temperatures of n nodes; -1 for prescribed
    values. motion: prescribed motion of the body frame, if any. held: prescribed temperatures.
    """

    surface: Surface
    frame: IntArray
    u: IntArray
    T: IntArray
    motion: FrameHistory | None
    held: PrescribedTemperatures

    @classmethod
    def from_surface(
        cls, surface: Surface, layout: Layout, *, moves: bool, deforms: bool, conducts: bool,
        motion: FrameHistory | None = None,
    ) -> Self:
        """Side of a surface; `moves`, `deforms`, `conducts`: include the rigid coordinates, the
        displacements, the temperatures as unknowns (global numbers, -1 for prescribed ones).
        Temperatures have a number for every node in any case, -1 if they are not included."""
        body, nodes = surface.body, surface.nodes
        none = np.zeros(0, np.int64)
        frame = body.position(layout, "rigid") if moves else none
        u = none
        if deforms and body.elasticity is not None:
            u = elastic_numbers(body, layout, nodes).ravel()
        T = thermal_numbers(body, layout, nodes) if conducts else np.full(len(nodes), -1)
        prescribed = PrescribedTemperatures()
        if conducts:
            prescribed = PrescribedTemperatures.from_body(body, nodes)
        return cls(surface, frame, u, T, motion, prescribed)

    def some(self, chosen: IntArray) -> tuple[Self, IntArray]:
        """Copy with the facets `chosen` only, and the positions of their nodes in the surface's
        `nodes`."""
        surface, used = self.surface.some(chosen)
        u = self.u.reshape(-1, surface.d)[used].ravel() if len(self.u) else self.u
        return replace(self, surface=surface, u=u, T=self.T[used], held=self.held.some(used)), used

    def pose(
        self, frame: FloatArray, rate: FloatArray, t: float
    ) -> tuple[FloatArray, FloatArray]:
        """Rigid coordinates of the body at time t (s), position first, and their rates: from the
        prescribed motion, from the present values `frame` and `rate` of the unknowns, if the body
        has some (self.frame: their numbers), or at rest in the initial pose."""
        if self.motion is not None:
            pose, velocity, _ = self.motion.at(t)
            return pose, velocity
        if len(self.frame):
            return frame, rate
        pose = self.surface.body.pose
        return pose, np.zeros_like(pose)


@dataclass(frozen=True, slots=True, eq=False)
class Sizes:
    """Numbers of local unknowns of a contact in d dimensions: f1, f2 rigid coordinates, u1, u2
    displacements, n1, n2 nodes of the two surfaces."""

    d: int
    f1: int
    f2: int
    u1: int
    u2: int
    n1: int
    n2: int

    @classmethod
    def from_sides(cls, first: ContactSide, second: ContactSide) -> "Sizes":
        return cls(first.surface.d, len(first.frame), len(second.frame), len(first.u),
                   len(second.u), len(first.surface.nodes), len(second.surface.nodes))

    @property
    def whole(self) -> int:
        """Number of rigid coordinates and displacements of both sides."""
        return self.f1 + self.f2 + self.u1 + self.u2

    @property
    def all(self) -> int:
        """Number of rigid coordinates, displacements and temperatures of both sides."""
        return self.whole + self.n1 + self.n2

    @property
    def frames(self) -> int:
        """Number of rigid coordinates of both bodies."""
        return self.f1 + self.f2

    def split(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Splits x (whole,) into the rigid coordinates and the nodal displacements (n, d) of both
        sides; displacements are zero for a side without them."""
        a, b = self.f1, self.frames
        c = b + self.u1
        u1 = x[b:c].reshape(-1, self.d) if self.u1 else np.zeros((self.n1, self.d))
        u2 = x[c:].reshape(-1, self.d) if self.u2 else np.zeros((self.n2, self.d))
        return x[:a], x[a:b], u1, u2

    def of_points(self, first: IntArray, second: IntArray) -> IntArray:
        """Local numbers of the rigid coordinates, and of the displacements and temperatures of the
        nodes `first` and `second` (positions in each surface's `nodes`)."""
        one, two = self.frames, self.frames + self.u1
        parts = [np.arange(self.frames)]
        if self.u1:
            parts.append((one + dofs(first, self.d)).ravel())
        if self.u2:
            parts.append((two + dofs(second, self.d)).ravel())
        return np.concatenate([*parts, self.whole + first, self.whole + self.n1 + second])

    def of_pairs(self, nodes: IntArray) -> IntArray:
        """(P, m) local numbers of the unknowns of P facet pairs: rigid coordinates, displacements,
        temperatures.

        nodes (P, 2 d): corners of both facets, the second surface's nodes numbered after the
        first's. frames, u1, u2: numbers of rigid coordinates and of displacements of each surface,
        0 where it does not deform; whole: their sum, behind which the temperatures are.
        """
        at = [np.broadcast_to(np.arange(self.frames), (len(nodes), self.frames))]
        if self.u1:
            at.append(self.frames + dofs(nodes[:, : self.d], self.d))
        if self.u2:
            at.append(self.frames + self.u1 + dofs(nodes[:, self.d :] - self.n1, self.d))
        return np.concatenate([*at, self.whole + nodes], axis=1)

    def touched(self, numbers: IntArray) -> tuple[BoolArray, BoolArray]:
        """(n1,), (n2,) True for nodes with at least one retained unknown; numbers: -1 for local
        unknowns and temperatures that are not retained."""
        some = numbers >= 0
        _, _, u1, u2 = self.split(some[: self.whole].astype(np.float64))
        T = some[self.whole :]
        return u1.any(axis=1) | T[: self.n1], u2.any(axis=1) | T[self.n1 : self.n1 + self.n2]


def dofs(nodes: IntArray, d: int) -> IntArray:
    """(P, d k) numbers of the vector components of nodes (P, k); also (P, d) for nodes (P,)."""
    return np.asarray((d * nodes[..., None] + np.arange(d)).reshape(len(nodes), -1))
