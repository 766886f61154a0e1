"""Global numbers of the displacements and temperatures of a surface's nodes, and prescribed
temperatures there."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sparsemor.bodies.body import FloatingBody
from sparsemor.core import Amplitude, FloatArray, IntArray, Layout


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
    """Prescribed temperatures of a surface: pairs of node positions and a function T(t), K."""

    prescribed: Sequence[tuple[IntArray, Amplitude]] = ()

    @classmethod
    def of(cls, body: FloatingBody, nodes: IntArray) -> Self:
        """Temperatures that the body prescribes at its `nodes` (n,), sorted."""
        if body.heat is None:
            return cls()
        return cls([(np.flatnonzero(np.isin(nodes, at)), f.value)
                    for at, f in body.heat.prescribed])

    def some(self, used: IntArray) -> "PrescribedTemperatures":
        """Prescribed temperatures at the subset `used` (m,) of the nodes, renumbered."""
        return replace(self, prescribed=[(np.flatnonzero(np.isin(used, at)), f)
                                         for at, f in self.prescribed])

    def filled(self, T: FloatArray, t: float) -> FloatArray:
        """Copy of the temperatures T (n,), K, with the prescribed ones set to their values at time
        t, s."""
        T = T.copy()
        for at, function in self.prescribed:
            T[at] = function(t)
        return T
