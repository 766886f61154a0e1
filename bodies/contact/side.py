"""One of the two surfaces of a contact as the term sees it: unknowns in, positions out."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sparsemor.bodies.contact.numbers import (
    Held,
    elastic_numbers,
    found_in,
    picked,
    renumbered,
    thermal_numbers,
)
from sparsemor.bodies.contact.surface import Surface
from sparsemor.bodies.planar.motion import ComplexArray
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.layout import Layout
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
        n = len(nodes)
        return cls(rigid if len(rigid) else np.full(3, -1),
                   elastic_numbers(body, layout, nodes) if u else np.full((n, 2), -1),
                   thermal_numbers(body, layout, nodes) if T else np.full(n, -1))

    def found_in(self, among: IntArray) -> Self:
        """The same places counted in a sorted list of numbers; -1 where the list lacks them."""
        return replace(self, frame=found_in(self.frame, among), u=found_in(self.u, among),
                       T=found_in(self.T, among))

    def kept(self, keep: IntArray, size: int) -> Self:
        """The same places, of a list of `size`, in the list of those that are kept."""
        return replace(self, frame=renumbered(self.frame, keep, size),
                       u=renumbered(self.u, keep, size), T=renumbered(self.T, keep, size))

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
    the frame, when it is told."""

    surface: Surface
    columns: Places
    rows: Places
    motion: FrameHistory | None
    held: Held

    @classmethod
    def of(
        cls, surface: Surface, layout: Layout, *, moves: bool, deforms: bool, conducts: bool,
        motion: FrameHistory | None = None,
    ) -> Self:
        """Places are still global numbers. moves: the frame's unknowns take part."""
        places = Places.of(surface, layout, moves, deforms, conducts)
        held = Held.of(surface.body, surface.nodes) if conducts else Held()
        return cls(surface, places, places, motion, held)

    def some(self, chosen: IntArray) -> "Side":
        """The same with some of the facets; places stay what they are."""
        surface, used = self.surface.some(chosen)
        columns, rows = (replace(p, u=p.u[used], T=p.T[used]) for p in (self.columns, self.rows))
        return Side(surface, columns, rows, self.motion, self.held.some(used))

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
                      self.held.filled(picked(x, at.T), t))


def _pairs(x: FloatArray, at: IntArray) -> ComplexArray:
    both = picked(x, at)
    return np.asarray(both[:, 0] + 1j * both[:, 1])
