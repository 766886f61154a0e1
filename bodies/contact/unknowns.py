"""Unknowns of a surface's points, and prescribed temperatures there."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sparsemor.bodies.body import Body
from sparsemor.core import Amplitude, FloatArray, IntArray, Layout


def elastic_numbers(body: Body, layout: Layout, nodes: IntArray) -> IntArray:
    """(n, d) global numbers of the displacements of points nodes (n,), -1 where there are none."""
    d = body.d
    numbers = np.full(d * len(body.X), -1)
    if body.elasticity is not None:
        numbers[body.elasticity.free] = body.position(layout, "elastic")
    return numbers.reshape(-1, d)[nodes]


def thermal_numbers(body: Body, layout: Layout, nodes: IntArray) -> IntArray:
    """(n,) global numbers of the temperatures of points nodes (n,), -1 where there are none."""
    numbers = np.full(len(body.X), -1)
    if body.heat is not None:
        numbers[body.heat.free] = body.position(layout, "thermal")
    return numbers[nodes]


def found_in(numbers: IntArray, among: IntArray) -> IntArray:
    """Positions of numbers in a sorted list; -1 where the list lacks them, or they are -1."""
    if not len(among):
        return np.full(numbers.shape, -1)
    at = np.minimum(np.searchsorted(among, numbers), len(among) - 1)
    return np.where((numbers >= 0) & (among[at] == numbers), at, -1)


def renumbered(positions: IntArray, kept: IntArray, size: int) -> IntArray:
    """Positions in a list of `size` as positions in the list of those `kept`, -1 where left out."""
    new = np.full(size + 1, -1)  # the last one for positions that are -1
    new[kept] = np.arange(len(kept))
    new[-1] = -1
    return np.asarray(new[positions])


def picked(x: FloatArray, at: IntArray) -> FloatArray:
    """x at positions `at`, 0 where one is -1."""
    return np.where(at >= 0, x[at], 0.0) if len(x) else np.zeros(at.shape)


@dataclass(frozen=True, slots=True, eq=False)
class PrescribedTemperatures:
    """Temperatures that are no unknowns: pairs of points of a surface and T(t), K."""

    prescribed: Sequence[tuple[IntArray, Amplitude]] = ()

    @classmethod
    def of(cls, body: Body, nodes: IntArray) -> Self:
        """Those that the body prescribes at points nodes (n,), sorted."""
        if body.heat is None:
            return cls()
        return cls([(np.flatnonzero(np.isin(nodes, at)), f.value)
                    for at, f in body.heat.prescribed])

    def some(self, used: IntArray) -> "PrescribedTemperatures":
        """Of some of the points alone."""
        return replace(self, prescribed=[(np.flatnonzero(np.isin(used, at)), f)
                                         for at, f in self.prescribed])

    def filled(self, T: FloatArray, t: float) -> FloatArray:
        """T (n,), K, with those prescribed at time t."""
        T = T.copy()
        for at, function in self.prescribed:
            T[at] = function(t)
        return T
