"""Local terms of an elastic block inside one step: nonlinear springs, temperature-dependent
stiffness. They are evaluated at each iterate, while the operator D of the iteration stays
constant."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sparsemor.core import FloatArray, IntArray
from sparsemor.core.protocols import ElasticLocal
from sparsemor.reducers.step.predictor import Prediction

GROWN = 10.0
"""Ratio of consecutive changes from which the iteration counts as divergent: local terms outweigh
D."""


class LocalForces(Protocol):
    """Local terms of one block, in the rows that its iteration uses."""

    @property
    def elements(self) -> int: ...
    def rows(
        self, u: FloatArray, v: FloatArray, a: FloatArray, T: FloatArray, rate: FloatArray,
        t: float, still: bool,
    ) -> FloatArray:
        """Forces at displacements u with v and a, and temperatures T with their rate, at t, s; of
        the terms that depend on temperatures alone if `still`, else of the others."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class FullLocal:
    """Local terms at full order: forces (n,) in the rows of the block."""

    parts: Sequence[ElasticLocal]

    @property
    def elements(self) -> int:
        return sum(part.term.elements for part in self.parts)

    def rows(
        self, u: FloatArray, v: FloatArray, a: FloatArray, T: FloatArray, rate: FloatArray,
        t: float, still: bool,
    ) -> FloatArray:
        """Forces of the terms that depend on temperatures alone (`still`), or of the others."""
        r = np.zeros(len(u))
        for part in self.parts:
            if bool(part.hot.all()) != still:
                continue
            x, xv, xa = (np.zeros(len(part.columns)) for _ in range(3))
            of_u, of_T = part.columns[~part.hot], part.columns[part.hot]
            x[~part.hot], xv[~part.hot], xa[~part.hot] = u[of_u], v[of_u], a[of_u]
            if len(of_T):
                x[part.hot], xv[part.hot] = T[of_T], rate[of_T]
            r[part.rows] += part.term.residual(x, xv, xa, t)
        return r


class StepForces:
    """Local terms of a block in one step, as a function of the increment of its displacements
    alone: temperatures are final. active: numbers of the unknowns that are solved for, None for
    all."""

    __slots__ = ("active", "at", "c1", "c2", "forces", "rate", "still")

    def __init__(
        self, forces: LocalForces, at: Prediction, rate: FloatArray, c1: float, c2: float,
        active: IntArray | None,
    ) -> None:
        self.forces, self.at, self.rate, self.active = forces, at, rate, active
        self.c1, self.c2 = c1, c2
        self.still = forces.rows(at.x, at.v, at.a, at.T, rate, at.t, True)

    def rows(self, d: FloatArray) -> FloatArray:
        """Forces at the increment d of the active unknowns."""
        at = self.at
        if self.active is not None:
            wide = np.zeros(len(at.x))
            wide[self.active] = d
            d = wide
        return self.still + self.forces.rows(
            at.x + d, at.v + self.c1 * d, at.a + self.c2 * d, at.T, self.rate, at.t, False)
