"""Operators and test maps of one block in a projection-based reducer, and a model with cheaper
operators."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from sparsemor.core import (
    AssembledModel,
    Csr,
    Dictionary,
    FloatArray,
    IntArray,
    Integrator,
    Note,
    OfflineProducts,
)
from sparsemor.core.protocols.separable import HeatBody, MovingBody
from sparsemor.reducers.step.projected_operators import TestMap


@dataclass(frozen=True, slots=True, eq=False)
class LinearOperators:
    """Linear operators of one block: stiffness x + damping v + mass a, (n, n) each.

    For heat, `stiffness` is the conductivity, `damping` the capacity, and there is no mass.
    `operator`: D = stiffness + c1 damping + c2 mass, where v = c1 x + r1 and a = c2 x + r2 in a
    step. damping_force: the whole damping as a function of v, with what is not sparse.
    """

    stiffness: Csr
    damping: Csr
    mass: Csr | None
    operator: Csr
    damping_force: Callable[[FloatArray], FloatArray]

    @classmethod
    def of(
        cls, source: HeatBody | MovingBody, c1: float, c2: float, c1_first: float
    ) -> "LinearOperators":
        if isinstance(source, HeatBody):
            K, C = source.conductivity, source.capacity
            return cls(K, C, None, K + c1_first * C, lambda v: np.asarray(C @ v))
        assert source.operators is not None
        o = source.operators
        return cls(o.stiffness, o.damping, o.mass, o.stiffness + c1 * o.damping + c2 * o.mass,
                   o.damping_force)

    def force(self, x: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Residual of the linear operators, stiffness x + damping v + mass a, for (n,) or (n, M)
        arrays."""
        f = self.stiffness @ x + self.damping_force(v)
        return np.asarray(f if self.mass is None else f + self.mass @ a)


@dataclass(frozen=True, slots=True, eq=False)
class Reducible:
    """One block of unknowns with the data its test maps are computed from: dictionary (trial
    basis), linear operators, model, integrator, step h (s), and a random generator of its own."""

    name: str
    dictionary: Dictionary
    linear: LinearOperators
    model: AssembledModel
    offline: OfflineProducts
    integrator: Integrator
    h: float
    rng: np.random.Generator

    @property
    def size(self) -> int:
        return int(self.dictionary.atoms.shape[0])


@dataclass(frozen=True, slots=True, eq=False)
class Maps:
    """Test maps (left projections) of one block.

    test: map of the block's linear operators; force: map of all other terms in its rows (None: the
    same map). rows: sampled rows, None for all; facts: numbers to report.
    """

    test: TestMap
    force: TestMap | None = None
    rows: IntArray | None = None
    facts: Mapping[str, float | int | str] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()

    @property
    def forces(self) -> TestMap:
        return self.test if self.force is None else self.force


@dataclass(frozen=True, slots=True, eq=False)
class Approximation:
    """Model whose operators are projected, where some of them may be replaced by cheaper ones
    (hyper-reduction).

    facts: numbers to report, by block; elements: number of elements by block that the replaced
    operators contain; notes: warnings about the replacement.
    """

    model: AssembledModel
    facts: Mapping[str, Mapping[str, float | int | str]] = field(default_factory=dict)
    elements: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
