"""One of the two surfaces of a contact as the term sees it: unknowns in, positions out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sparsemor.bodies.contact.surface import Surface
from sparsemor.bodies.planar.motion import ComplexArray
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.layout import Layout
from sparsemor.core.separable import Amplitude
from sparsemor.core.stage import FrameHistory


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Where a surface's unknowns are in some list, -1: nowhere. frame (3,), u (n, 2), T (n,)."""

    frame: IntArray
    u: IntArray
    T: IntArray

    @classmethod
    def of(cls, surface: Surface, layout: Layout, frame: bool, u: bool, T: bool) -> Self:
        """Global numbers of the blocks that are asked for."""
        body, nodes = surface.body, surface.nodes
        rigid = body.position(layout, "rigid") if frame else np.zeros(0, np.int64)
        at_u = np.full(2 * len(body.X), -1)
        if u and body.elasticity is not None:
            at_u[body.elasticity.free] = body.position(layout, "elastic")
        at_T = np.full(len(body.X), -1)
        if T and body.heat is not None:
            at_T[body.heat.free] = body.position(layout, "thermal")
        return cls(rigid if len(rigid) else np.full(3, -1), at_u.reshape(-1, 2)[nodes], at_T[nodes])

    def found_in(self, sorted_numbers: IntArray) -> Self:
        """The same places counted in a sorted list of numbers; -1 where the list lacks them."""
        def find(numbers: IntArray) -> IntArray:
            if not len(sorted_numbers):
                return np.full(numbers.shape, -1)
            at = np.minimum(np.searchsorted(sorted_numbers, numbers), len(sorted_numbers) - 1)
            return np.where((numbers >= 0) & (sorted_numbers[at] == numbers), at, -1)

        return replace(self, frame=find(self.frame), u=find(self.u), T=find(self.T))

    def all(self) -> IntArray:
        """Those that are somewhere."""
        numbers = np.concatenate([self.frame, self.u.ravel(), self.T])
        return np.asarray(numbers[numbers >= 0])


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Positions of a surface's points. frame R, e = exp(i theta); r, z, rate (n,): from the frame
    origin, in space, and velocity; slide (n,): the velocity without the origin's; T (n,) K."""

    R: complex
    e: complex
    spin: float
    r: ComplexArray
    z: ComplexArray
    rate: ComplexArray
    slide: ComplexArray
    T: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """columns: where the unknowns are among the term's columns; rows: among its rows. motion: of
    the frame, when it is told; given: (points, T(t)) of temperatures that are no unknowns."""

    surface: Surface
    columns: Places
    rows: Places
    motion: FrameHistory | None
    given: Sequence[tuple[IntArray, Amplitude]]

    @classmethod
    def of(
        cls, surface: Surface, layout: Layout, *, moves: bool, deforms: bool, conducts: bool,
        motion: FrameHistory | None = None,
    ) -> Self:
        """Places are still global numbers. moves: the frame's unknowns take part."""
        places = Places.of(surface, layout, moves, deforms, conducts)
        heat = surface.body.heat
        held = () if heat is None or not conducts else tuple(
            (np.flatnonzero(np.isin(surface.nodes, at)), f.value) for at, f in heat.prescribed)
        return cls(surface, places, places, motion, held)

    def some(self, chosen: IntArray) -> "Side":
        """The same with some of the facets; places stay what they are."""
        surface, used = self.surface.some(chosen)
        columns, rows = (replace(p, u=p.u[used], T=p.T[used]) for p in (self.columns, self.rows))
        given = [(np.flatnonzero(np.isin(used, at)), f) for at, f in self.given]
        return Side(surface, columns, rows, self.motion, given)

    def points(self, x: FloatArray, v: FloatArray, t: float) -> Points:
        """At unknowns and rates x, v (n,) of the term's columns."""
        at = self.columns
        pose, rate = self.surface.body.pose, np.zeros(3)
        if self.motion is not None:
            pose, rate, _ = self.motion.at(t)
        elif at.frame[0] >= 0:
            pose, rate = x[at.frame], v[at.frame]
        R, e, spin = complex(pose[0], pose[1]), complex(np.exp(1j * pose[2])), float(rate[2])
        r: ComplexArray = e * self.surface.X
        slide: ComplexArray = 0.0 * r
        moved = (at.u >= 0).any(axis=1)
        if moved.any():
            r = r + e * _pairs(x, at.u)
            slide = e * _pairs(v, at.u)
        slide = slide + 1j * spin * r
        return Points(R, e, spin, r, R + r, complex(rate[0], rate[1]) + slide, slide,
                      self._temperature(x, t))

    def _temperature(self, x: FloatArray, t: float) -> FloatArray:
        T = picked(x, self.columns.T)
        for at, function in self.given:
            T[at] = function(t)
        return T


def picked(x: FloatArray, at: IntArray) -> FloatArray:
    """x at places `at`, 0 where a place is -1: nowhere."""
    return np.where(at >= 0, x[at], 0.0) if len(x) else np.zeros(at.shape)


def _pairs(x: FloatArray, at: IntArray) -> ComplexArray:
    both = picked(x, at)
    return np.asarray(both[:, 0] + 1j * both[:, 1])
